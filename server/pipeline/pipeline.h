// The pipeline of stages: segmentation, tracking, hull, colouring, pose. One frame set in, one result out, on
// the calling thread and oneTBB's workers. Runner (runner.h) adds threads, a source and subscribers.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/stopwatch.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/segmentation.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/subject_control.h"
#include "server/pipeline/subject_views.h"
#include "server/pipeline/tracking/tracker.h"
#include "server/pose/pose_options.h"

namespace kinevox {

class Gpu;
class PoseStage;

struct PipelineOptions {
    kernels::Device device;
    // If set, this GPU computes until it fails, then the CPU does, and `device` is ignored. Otherwise a
    // failure of the GPU is an error.
    std::shared_ptr<Gpu> gpu;
    double voxel_m = 0.01;
    bool colouring = true;
    bool keep_hulls = false;  // SubjectResult::hull
    bool pose = true;
    bool allow_discontinuities = false;  // frame sets may come after_discontinuity
    kernels::SegmentationOptions segmentation;
    kernels::HullOptions hull;
    kernels::ColouringOptions colour;
    TrackerOptions tracker;  // its voxel_m is set from the one above
    PoseStageOptions posing;

    // Empty when usable, else one sentence.
    std::string check() const;
};

// Calls f(TABLE, options) for each part whose options are listed (kernels/option_list.h), by the names of its
// tables in the configuration file.
template <typename T, typename F>
requires kernels::SameOptions<T, PipelineOptions>
void visit_option_tables(T& options, F&& f) {
    f("segmentation", options.segmentation);
    f("tracking", options.tracker);
    f("hull", options.hull);
    f("colouring", options.colour);
    f("pose", options.posing);
    f("pose.tracking", options.posing.tracker);
    f("pose.fit", options.posing.tracker.fit);
    f("pose.filter", options.posing.filter);
}

// Of one of the result's subjects, the further input of its pose stage.
struct SubjectReconstruction {
    std::vector<std::size_t> inlier_cameras;  // including truncated ones
    kernels::VoxelVolume volume;              // the subject's, if it has one
    bool hull_to_come = false;                // the GPU makes it when it is coloured
    kernels::VoxelVolume coarse;              // the same with PoseStage::kCoarseFactor times the voxels
    bool beside_others = false;               // then the next line is of this frame set
    SubjectViews views;
};

// A frame set with its volumes.
struct Reconstruction {
    Stopwatch since_arrival;
    std::shared_ptr<FrameResult> result;          // without the poses
    bool first_of_track = false;                  // the tracks were reset before it
    std::vector<SubjectReconstruction> subjects;  // as result->subjects; further ones are spare memory
};

// Two halves, so that the pose of one frame set can be found while the next is reconstructed: no stage of the
// first half depends on a pose, so the numbers are the same either way.
class Pipeline {
  public:
    // InvalidArgument for options out of range, fewer than two cameras or unsupported images;
    // FailedPrecondition if the device is absent.
    static absl::StatusOr<std::unique_ptr<Pipeline>> create(std::vector<Camera> cameras, double fps,
                                                            const PipelineOptions& options);
    virtual ~Pipeline() = default;

    // Per camera, in the order of the cameras, at least one background image. InvalidArgument names the
    // camera whose images are missing or have another size.
    virtual absl::Status learn_background(const std::vector<std::vector<Image>>& empty_scene) = 0;

    // The first half, segmentation to colouring, and learn_background() and reset_track() are one thread's.
    // InvalidArgument for images that do not match the cameras, FailedPrecondition before the background was
    // learned. The numbers depend on the frame sets only, not on the number of threads. A frame set
    // after_discontinuity is treated as the first after learn_background(): track, poses and background
    // updates are reset.
    virtual absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(FrameSet frame_set) = 0;

    // The second half, by one thread, which may be another; every reconstruction, in order.
    virtual absl::StatusOr<FrameResultPtr> pose(std::unique_ptr<Reconstruction> reconstruction) = 0;

    // Both.
    absl::StatusOr<FrameResultPtr> process(FrameSet frame_set);

    // Replaces SegmentationOptions::judge_faint from the next frame set on. By any thread.
    virtual void set_judge_faint(bool judge) = 0;

    // Resets the track, keeps the backgrounds.
    virtual void reset_track() = 0;

    // Another calibration of the same cameras: same names, order and sizes. Resets the track, keeps the
    // backgrounds and the body. While both halves are idle.
    virtual void set_cameras(std::vector<Camera> cameras) = 0;

    // The first subject's pose stage, null without one; stays at its address. Touched only between calls of
    // pose(), by the same thread.
    virtual PoseStage* pose_stage() = 0;
    // That of a subject of the last pose(); null without one.
    virtual PoseStage* pose_stage_of(std::uint32_t subject_id) = 0;

    // An operator's requests; null unless several subjects are followed.
    virtual std::shared_ptr<SubjectControl> subject_control() { return nullptr; }
};

}  // namespace kinevox
