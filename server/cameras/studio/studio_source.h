// The virtual studio as a frame source: endless, the motion repeats.
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <vector>

#include "server/cameras/frame_source.h"
#include "server/cameras/studio/studio.h"

namespace kinevox {

struct StudioSourceOptions {
    studio::StudioOptions studio;
    Pacing pacing = Pacing::kRealTime;
    int background_frames = 40;  // background images per camera; 1 .. 1000
    bool parallel = false;       // renders the cameras in parallel; the same bits
};

class StudioSource final : public FrameSource {
  public:
    // InvalidArgument with one sentence for invalid options.
    static absl::StatusOr<std::unique_ptr<StudioSource>> create(const StudioSourceOptions& options);

    const std::vector<Camera>& cameras() const override { return studio_->cameras(); }
    double fps() const override { return options_.studio.fps; }
    std::int64_t frame_count() const override { return -1; }
    absl::StatusOr<std::vector<std::vector<Image>>> background() override;
    absl::StatusOr<FrameSet> next() override;
    void stop() override;

    // Ground truth of frame `sequence`.
    studio::SubjectTruth truth(std::uint64_t sequence) const {
        return studio_->truth(static_cast<std::int64_t>(sequence));
    }

  private:
    StudioSource(const StudioSourceOptions& options, std::unique_ptr<studio::Studio> studio)
        : options_(options), studio_(std::move(studio)) {}

    StudioSourceOptions options_;
    std::unique_ptr<studio::Studio> studio_;
    std::int64_t next_frame_ = 0;
    std::int64_t start_ns_ = 0;  // steady clock, of frame 0; set by the first next()
    std::mutex mutex_;
    std::condition_variable stopped_changed_;
    bool stopped_ = false;
};

}  // namespace kinevox
