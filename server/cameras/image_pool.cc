#include "server/cameras/image_pool.h"

#include <mutex>
#include <utility>
#include <vector>

namespace kinevox {

struct ImagePool::Shelf {
    std::size_t bytes = 0, keep = 0;
    std::mutex mutex;
    std::vector<std::unique_ptr<std::uint8_t[]>> idle;
};

ImagePool::ImagePool(std::size_t bytes, std::size_t keep) : shelf_(std::make_shared<Shelf>()) {
    shelf_->bytes = bytes;
    shelf_->keep = keep;
}

std::size_t ImagePool::bytes() const {
    return shelf_->bytes;
}

std::shared_ptr<std::uint8_t[]> ImagePool::take() {
    std::unique_ptr<std::uint8_t[]> buffer;
    {
        const std::lock_guard lock(shelf_->mutex);
        if (!shelf_->idle.empty()) {
            buffer = std::move(shelf_->idle.back());
            shelf_->idle.pop_back();
        }
    }
    if (!buffer) buffer = std::make_unique_for_overwrite<std::uint8_t[]>(shelf_->bytes + kImagePaddingBytes);
    return {buffer.release(), [shelf = shelf_](std::uint8_t* data) {
                std::unique_ptr<std::uint8_t[]> back(data);
                const std::lock_guard lock(shelf->mutex);
                if (shelf->idle.size() < shelf->keep) shelf->idle.push_back(std::move(back));
            }};
}

}  // namespace kinevox
