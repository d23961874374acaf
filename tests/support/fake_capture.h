// A capture without cameras or compute: a source that hands out what the test gives it, and a pipeline that
// turns each frame set into a known volume. Nothing here sleeps.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>

#include "server/cameras/frame_source.h"
#include "server/pipeline/pipeline.h"

namespace kinevox::testing {

// Two cameras "left" and "right", 64 x 48 px, 100 frame sets a second.
std::vector<Camera> fake_cameras();

// What a test and the sources it made share; lives longer than both.
class FakeSourceControl {
  public:
    bool with_background = true;
    // To be set before the start.
    bool live = false;     // times are the steady clock's
    bool cameras = false;  // the source has links

    int waiting() const;  // frame sets that may still be handed out

    void give(int frame_sets);            // makes this number of further frame sets available
    void end();                           // the recording is over after those
    void fail(absl::Status status);       // next() says so after those
    void lose(int frame_sets);            // a gap in the sequence before the next one
    std::unique_ptr<FrameSource> open();  // a source from sequence 0
    int opened() const;

  private:
    friend class FakeSource;
    mutable std::mutex mutex_;
    std::condition_variable changed_;
    int waiting_ = 0, lost_ = 0, opened_ = 0;
    std::optional<absl::Status> last_;
};

// Every result has `volume`, learn_background() succeeds. Counts calls.
class FakePipeline : public Pipeline {
  public:
    explicit FakePipeline(std::shared_ptr<const Volume> volume) : volume_(std::move(volume)) {}

    absl::Status learn_background(const std::vector<std::vector<Image>>& empty_scene) override;
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(FrameSet frame_set) override;
    absl::StatusOr<FrameResultPtr> pose(std::unique_ptr<Reconstruction> reconstruction) override;
    void set_judge_faint(bool) override {}
    void reset_track() override {}
    void set_cameras(std::vector<Camera> cameras) override { cameras_set = std::move(cameras); }
    PoseStage* pose_stage() override { return nullptr; }
    PoseStage* pose_stage_of(std::uint32_t) override { return nullptr; }
    std::shared_ptr<SubjectControl> subject_control() override { return control; }

    std::shared_ptr<SubjectControl> control;  // null: one subject

    std::vector<Camera> cameras_set;  // by set_cameras(); read when nothing runs
    std::size_t learned_images = 0;   // a camera; read when nothing runs
    // To be set before the start.
    std::optional<absl::Status> reconstruct_error, pose_error;
    std::function<void(std::uint64_t)> on_reconstruct, on_pose;  // with the sequence, at its begin

  private:
    std::shared_ptr<const Volume> volume_;
};

// Joints along x at z = 1 m, 0.5 rad in every angle; the last joint and the first angle are withheld.
std::shared_ptr<const BodyPose> fake_pose(std::uint64_t sequence);

// A result of the given number with `volume`, without images.
FrameResultPtr fake_result(std::uint64_t sequence, std::shared_ptr<const Volume> volume);

}  // namespace kinevox::testing
