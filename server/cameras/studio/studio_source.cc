#include "server/cameras/studio/studio_source.h"

#include <absl/status/status.h>
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>

namespace kinevox {
namespace {

std::int64_t now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

}  // namespace

absl::StatusOr<std::unique_ptr<StudioSource>> StudioSource::create(const StudioSourceOptions& options) {
    if (options.background_frames < 1 || options.background_frames > 1000)
        return absl::InvalidArgumentError(
            fmt::format("studio: background_frames is {}; it must be 1 .. 1000", options.background_frames));
    absl::StatusOr<std::unique_ptr<studio::Studio>> studio = studio::Studio::create(options.studio);
    if (!studio.ok()) return studio.status();
    return std::unique_ptr<StudioSource>(new StudioSource(options, *std::move(studio)));
}

absl::StatusOr<std::vector<std::vector<Image>>> StudioSource::background() {
    std::vector<std::vector<Image>> images(cameras().size());
    for (std::size_t camera = 0; camera < cameras().size(); ++camera)
        for (int frame = 0; frame < options_.background_frames; ++frame) {
            {  // stop() does not wait for the last image
                const std::lock_guard lock(mutex_);
                if (stopped_) return absl::CancelledError("the virtual studio was stopped");
            }
            images[camera].push_back(studio_->draw_empty(camera, frame));
        }
    return images;
}

absl::StatusOr<FrameSet> StudioSource::next() {
    const double period_ns = 1e9 / options_.studio.fps;
    {
        std::lock_guard lock(mutex_);
        if (stopped_) return absl::CancelledError("the virtual studio was stopped");
    }
    if (options_.pacing == Pacing::kRealTime) {
        const std::int64_t now = now_ns();
        if (start_ns_ == 0) start_ns_ = now;
        // The latest frame whose time is not over; earlier ones are skipped.
        const auto current =
            static_cast<std::int64_t>(std::floor(static_cast<double>(now - start_ns_) / period_ns));
        next_frame_ = std::max(next_frame_, current);
    }
    FrameSet set;
    set.sequence = static_cast<std::uint64_t>(next_frame_);
    set.capture_time_ns = start_ns_ + std::llround(static_cast<double>(next_frame_) * period_ns);
    set.images = studio_->draw(next_frame_, options_.parallel);
    ++next_frame_;
    if (options_.pacing == Pacing::kRealTime) {  // rendered ahead, handed out when due
        std::unique_lock lock(mutex_);
        const auto due = std::chrono::steady_clock::time_point(std::chrono::nanoseconds(set.capture_time_ns));
        if (stopped_changed_.wait_until(lock, due, [&] { return stopped_; }))
            return absl::CancelledError("the virtual studio was stopped");
    }
    return set;
}

void StudioSource::stop() {
    {
        std::lock_guard lock(mutex_);
        stopped_ = true;
    }
    stopped_changed_.notify_all();
}

}  // namespace kinevox
