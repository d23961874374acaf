#include "server/pipeline/background_learner.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace kinevox {

absl::Status CollectedBackground::check() const {
    if (sufficient()) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("only {} of {} frame sets had an image of every camera; check which camera delivers none",
                    images.front().size(), seen));
}

void BackgroundLearner::begin(int wanted, std::size_t camera_count, std::function<void(absl::Status)> done) {
    const std::scoped_lock lock(mutex_);
    collected_ =
        CollectedBackground{wanted, 0, std::vector<std::vector<Image>>(camera_count), std::move(done)};
    latest_at_ = Clock::now();
}

bool BackgroundLearner::active() const {
    const std::scoped_lock lock(mutex_);
    return collected_.has_value();
}

std::optional<CollectedBackground> BackgroundLearner::add(const FrameSet& frame_set) {
    const std::scoped_lock lock(mutex_);
    if (!collected_) return std::nullopt;
    CollectedBackground& collected = *collected_;
    ++collected.seen;
    latest_at_ = Clock::now();
    const bool usable = frame_set.images.size() == collected.images.size() &&
                        std::ranges::none_of(frame_set.images, &Image::empty);
    if (usable)
        for (std::size_t c = 0; c < collected.images.size(); ++c)
            collected.images[c].push_back(frame_set.images[c]);
    const bool hopeless = collected.seen >= 3 * collected.wanted + 30;
    if (!collected.sufficient() && !hopeless) return std::nullopt;
    return std::exchange(collected_, std::nullopt);
}

std::optional<CollectedBackground> BackgroundLearner::take_idle(std::chrono::milliseconds idle_timeout) {
    const std::scoped_lock lock(mutex_);
    if (!collected_ || Clock::now() - latest_at_ < idle_timeout) return std::nullopt;
    return std::exchange(collected_, std::nullopt);
}

std::optional<CollectedBackground> BackgroundLearner::take() {
    const std::scoped_lock lock(mutex_);
    return std::exchange(collected_, std::nullopt);
}

}  // namespace kinevox
