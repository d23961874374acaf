// The stages strung together: segmentation, tracking, hull, colouring, pose. One frame set in, one result out, on the
// calling thread and oneTBB's workers. Runner (runner.h) gives it a thread, a source and subscribers.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "common/camera.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/segmentation.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/tracking/tracker.h"
#include "server/pose/pose_options.h"

namespace kinevox {

class PoseStage;

struct PipelineOptions {
    kernels::Device device = kernels::Device::kCpu;
    double voxel_m = 0.01;
    bool colouring = true;
    bool pose = true;
    kernels::SegmentationOptions segmentation;
    kernels::HullOptions hull;
    kernels::ColouringOptions colour;
    TrackerOptions tracker;   // its voxel_m is taken from above
    PoseStageOptions posing;

    // Empty when usable, else one sentence.
    std::string check() const;
};

class Pipeline {
  public:
    // InvalidArgument for options out of range, fewer than two cameras or pictures the kernels refuse;
    // FailedPrecondition where the device is absent.
    static absl::StatusOr<std::unique_ptr<Pipeline>> create(std::vector<Camera> cameras, double fps,
                                                            const PipelineOptions& options);
    virtual ~Pipeline() = default;

    // Per camera, in the order of the cameras, the pictures of the empty scene, at least one each. InvalidArgument
    // names the camera whose pictures are missing or have another size.
    virtual absl::Status learn_background(const std::vector<std::vector<Picture>>& empty_scene) = 0;

    // One frame set through all stages. Not thread safe. InvalidArgument for pictures that do not fit the cameras,
    // FailedPrecondition before the background was learned. The numbers depend on the frame sets alone, not on the
    // number of threads.
    virtual absl::StatusOr<FrameResultPtr> process(FrameSet frame_set) = 0;

    // Forgets the track, keeps the backgrounds.
    virtual void reset_track() = 0;

    // The pose stage, null without one. Touched only between calls of process().
    virtual PoseStage* pose_stage() { return nullptr; }
};

}  // namespace kinevox
