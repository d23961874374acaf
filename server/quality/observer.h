// Observes a selection of frame sets and measures what the judges need. Independent of the tracker: every
// image is segmented completely, with a background model of its own, because a spoiled session may have no
// track.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/body_pose.h"
#include "common/camera.h"
#include "server/pipeline/frame_result.h"
#include "server/pose/body_shape.h"
#include "server/quality/measurements.h"

namespace kinevox {
struct SilhouetteSet;
}

namespace kinevox::quality {

struct ObserverOptions {
    // Images are reduced until their longer side is at most this, px.
    int max_side_px = 640;
    std::size_t max_samples = 40;  // frame sets held; beyond, every other one is dropped
    bool latest = false;           // or rather the oldest one, for a live capture
    bool judge_faint = false;      // of the segmentation
};

struct PosedFrame {
    std::uint64_t sequence = 0;
    std::shared_ptr<const BodyPose> pose;  // null: none
};

// The poses of one subject, as far as it was tracked.
struct PosedSubject {
    std::uint32_t id = 0;  // 0: the only one
    std::vector<PosedFrame> poses;
    const BodyShape* body = nullptr;  // with which they were found; null without poses
};

// Not thread safe.
class Observer {
  public:
    // `background`: per camera, as for Pipeline::learn_background().
    Observer(const std::vector<Camera>& cameras, const std::vector<std::vector<Image>>& background,
             const ObserverOptions& options = {});
    ~Observer();

    // Every frame set, in order.
    void add(const FrameResult& result);
    // Of each subject and the scene, which is measured once; without subjects one of the scene. Everything
    // but RigMeasurements::time, and of the body what is known only to the caller. With several subjects,
    // or where others are excluded (`selected`: by rules), what compares the silhouettes of all people with
    // one body is absent.
    std::vector<Measurements> measure(std::span<const PosedSubject> subjects, bool selected = false) const;
    // Sequence numbers below are not needed by measure() any more.
    std::uint64_t first_sequence() const;

  private:
    Measurements measure_scene(SilhouetteSet& silhouettes) const;
    void measure_subject(const PosedSubject& posed, const SilhouetteSet& silhouettes, bool only,
                         Measurements& out) const;
    struct State;
    std::unique_ptr<State> state_;
};

}  // namespace kinevox::quality
