// The stages strung together: segmentation, tracking, hull, colouring, pose. One frame set in, one result
// out, on the calling thread and oneTBB's workers. Runner (runner.h) gives it threads, a source and
// subscribers.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/camera.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/segmentation.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/tracking/tracker.h"
#include "server/pose/pose_options.h"

namespace kinevox {

class Gpu;
class PoseStage;

struct PipelineOptions {
    kernels::Device device = kernels::Device::kCpu;
    // Where it is given, this GPU computes until it fails, then the CPU does, and `device` says nothing.
    // Without it a GPU's failure is an error.
    std::shared_ptr<Gpu> gpu;
    double voxel_m = 0.01;
    bool colouring = true;
    bool pose = true;
    bool jumps = false;  // frame sets may come after_jump
    kernels::SegmentationOptions segmentation;
    kernels::HullOptions hull;
    kernels::ColouringOptions colour;
    TrackerOptions tracker;  // its voxel_m is taken from above
    PoseStageOptions posing;

    // Empty when usable, else one sentence.
    std::string check() const;
};

// A frame set with its volume: the result so far, and what the pose stage needs besides.
struct Reconstruction {
    std::chrono::steady_clock::time_point arrived;
    std::shared_ptr<FrameResult> result;       // all but the pose
    bool first_of_track = false;               // the track was forgotten before it
    std::vector<std::size_t> carving_cameras;  // that agree on the subject
    kernels::VoxelVolume volume;               // result->volume, where there is one
    kernels::VoxelVolume coarse;               // the same with PoseStage::kCoarser times the voxels
};

// Two halves, so that the pose of one frame set can be found while the next is reconstructed: no stage of the
// first half asks for a pose, so the numbers are the same either way.
class Pipeline {
  public:
    // InvalidArgument for options out of range, fewer than two cameras or pictures the kernels refuse;
    // FailedPrecondition where the device is absent.
    static absl::StatusOr<std::unique_ptr<Pipeline>> create(std::vector<Camera> cameras, double fps,
                                                            const PipelineOptions& options);
    virtual ~Pipeline() = default;

    // Per camera, in the order of the cameras, the pictures of the empty scene, at least one each.
    // InvalidArgument names the camera whose pictures are missing or have another size.
    virtual absl::Status learn_background(const std::vector<std::vector<Picture>>& empty_scene) = 0;

    // The first half, segmentation to colouring, and learn_background() and reset_track() are one thread's.
    // InvalidArgument for pictures that do not fit the cameras, FailedPrecondition before the background was
    // learned. The numbers depend on the frame sets alone, not on the number of threads. A frame set that
    // comes after_jump is treated as the first after learn_background(): track, poses and what the frames
    // taught the background are forgotten.
    virtual absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(FrameSet frame_set) = 0;

    // The second half, one thread's too, which may be another; every reconstruction, in their order.
    virtual absl::StatusOr<FrameResultPtr> pose(std::unique_ptr<Reconstruction> reconstruction) = 0;

    // Both.
    absl::StatusOr<FrameResultPtr> process(FrameSet frame_set);

    // Forgets the track, keeps the backgrounds.
    virtual void reset_track() = 0;

    // Other places and lenses of the same cameras: same names, order and sizes. Forgets the track, keeps the
    // backgrounds and the body. While nothing is in either half.
    virtual void set_cameras(std::vector<Camera> cameras) = 0;

    // The pose stage, null without one; stays at its address. Touched only between calls of pose(), by the
    // same thread.
    virtual PoseStage* pose_stage() = 0;
};

}  // namespace kinevox
