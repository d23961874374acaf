// The pipeline's result for one frame set. Plain data, shared and immutable once published.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "common/geometry.h"
#include "common/volume.h"
#include "kernels/segmentation.h"
#include "server/cameras/frame_source.h"
#include "server/events/event.h"

namespace kinevox {

struct StageTimes {
    double decode_ms = 0;  // waiting for and decoding the images; not included in total_ms
    double segmentation_ms = 0;
    double tracking_ms = 0;
    double hull_ms = 0;  // near 0 on a GPU: it carves and colours at once, in colouring_ms
    double colouring_ms = 0;
    double pose_ms = 0;   // 0 without a pose stage
    double total_ms = 0;  // from the frame set's arrival in the pipeline to its result
};

// The tracker's estimate of a subject after this frame set.
struct SubjectTrack {
    std::uint32_t subject_id = 0;
    Vec3 centre_in_world;            // G, m: nearest to the viewing rays of all silhouettes' centres
    Vec3 velocity_in_world;          // m/s
    double centre_std_m = 0;         // of G, one axis
    std::vector<bool> used_cameras;  // per camera: its ray is an inlier
    std::string name;                // given by an operator; empty: none
};

// What a frame set shows of one tracked subject.
struct SubjectResult {
    SubjectTrack track;
    std::shared_ptr<const Volume> volume;  // coloured; null if the frame set does not show the subject.
                                           // Shared, so that a queued volume does not keep the images alive
    std::shared_ptr<const Volume> hull;    // before colour carving, without colours; only on request
    std::shared_ptr<const BodyPose> pose;  // null without a volume or a pose
    std::vector<float> silhouette_iou;     // per camera, 0..1, NaN if there is nothing to compare
};

struct FrameResult {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    FrameSet frame_set;                             // the images it was computed from
    std::vector<kernels::Silhouettes> silhouettes;  // per camera
    std::vector<SubjectResult> subjects;            // those tracked, in the order of their ids
    int bystanders = 0;                             // people separated from the subjects, not followed
    std::vector<Event> events;
    StageTimes times;

    // Null while no subject is tracked.
    const SubjectResult* first_subject() const { return subjects.empty() ? nullptr : &subjects.front(); }
};

using FrameResultPtr = std::shared_ptr<const FrameResult>;

}  // namespace kinevox
