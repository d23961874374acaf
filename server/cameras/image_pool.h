// A pool of buffers of one size; a buffer returns when its last owner releases it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace kinevox {

// Padding after an image: SIMD code, libswscale in particular, may access this many bytes beyond the end.
inline constexpr std::size_t kImagePaddingBytes = 64;

// Thread-safe. Buffers may outlive the pool. Keeps at most `max_idle` unused buffers. Each has
// kImagePaddingBytes bytes of padding.
class ImagePool {
  public:
    explicit ImagePool(std::size_t bytes, std::size_t max_idle = 32) : shelf_(std::make_shared<Shelf>()) {
        shelf_->bytes = bytes;
        shelf_->max_idle = max_idle;
    }

    std::shared_ptr<std::uint8_t[]> take() {
        std::unique_ptr<std::uint8_t[]> buffer;
        {
            const std::lock_guard lock(shelf_->mutex);
            if (!shelf_->idle.empty()) {
                buffer = std::move(shelf_->idle.back());
                shelf_->idle.pop_back();
            }
        }
        if (!buffer)
            buffer = std::make_unique_for_overwrite<std::uint8_t[]>(shelf_->bytes + kImagePaddingBytes);
        return {buffer.release(), [shelf = shelf_](std::uint8_t* data) {
                    std::unique_ptr<std::uint8_t[]> back(data);
                    const std::lock_guard lock(shelf->mutex);
                    if (shelf->idle.size() < shelf->max_idle) shelf->idle.push_back(std::move(back));
                }};
    }
    std::size_t bytes() const { return shelf_->bytes; }

  private:
    struct Shelf {
        std::size_t bytes = 0, max_idle = 0;
        std::mutex mutex;
        std::vector<std::unique_ptr<std::uint8_t[]>> idle;
    };
    std::shared_ptr<Shelf> shelf_;
};

}  // namespace kinevox
