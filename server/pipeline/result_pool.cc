#include "server/pipeline/result_pool.h"

#include <mutex>
#include <utility>
#include <vector>

namespace kinevox {
namespace {

constexpr std::size_t kKeptIdle = 4;

}  // namespace

struct ResultPool::Shelf {
    std::mutex mutex;
    std::vector<std::unique_ptr<FrameResult>> idle;
};

ResultPool::ResultPool() : shelf_(std::make_shared<Shelf>()) {}

std::shared_ptr<FrameResult> ResultPool::take() {
    std::unique_ptr<FrameResult> result;
    {
        const std::lock_guard lock(shelf_->mutex);
        if (!shelf_->idle.empty()) {
            result = std::move(shelf_->idle.back());
            shelf_->idle.pop_back();
        }
    }
    if (!result) result = std::make_unique<FrameResult>();
    return {result.release(), [shelf = shelf_](FrameResult* used) {
                std::unique_ptr<FrameResult> back(used);
                // The images and the volume go now, the silhouettes' buffers stay.
                auto silhouettes = std::move(back->silhouettes);
                *back = FrameResult{};
                back->silhouettes = std::move(silhouettes);
                const std::lock_guard lock(shelf->mutex);
                if (shelf->idle.size() < kKeptIdle) shelf->idle.push_back(std::move(back));
            }};
}

}  // namespace kinevox
