// What the pipeline made of one frame set. Plain data, shared and never changed once published.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "common/geometry.h"
#include "common/volume.h"
#include "kernels/segmentation.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct StageTimes {
    double decode_ms = 0;  // waiting for and decoding the pictures; not part of total_ms
    double segmentation_ms = 0;
    double tracking_ms = 0;
    double hull_ms = 0;
    double colouring_ms = 0;
    double pose_ms = 0;   // 0 without a pose stage
    double total_ms = 0;  // from the frame set's arrival in the pipeline to its result
};

// What the tracker holds true of a subject after this frame set.
struct SubjectTrack {
    std::uint32_t subject_id = 0;
    Vec3 centre_in_world;           // G, m: nearest to the viewing rays of all silhouettes' centres
    Vec3 velocity_in_world;         // m/s
    double centre_std_m = 0;        // of G, one axis
    std::vector<bool> camera_used;  // per camera: its ray agreed
};

enum class EventKind {
    kSubjectFound,
    kSubjectLost,
    kCameraLeftOut,  // its ray or silhouette disagrees with the others'
    kCameraBack,
    kCameraSilent,  // delivered no picture
    kBackgroundLearned,
    kStarted,
    kStopped,
    kSourceEnded,
    kControlTaken,  // an operator acquired, released or lost control
    kControlReleased,
    kPoseDatabase,    // built or read, and why
    kBodyFitted,      // to the subject
    kCameraMoved,     // it seems to have: its calibration is suspect
    kCameraInPlace,   // its calibration agrees again
    kCalibration,     // solved, applied, undone or imported
    kCameraLost,      // it is not there
    kCameraRejoined,  // it delivers again
    kCameraLosses,    // pictures of it were lost on the way
    kRecordingStarted,
    kRecordingStopped,  // by request or with the capture
    kRecordingFailed,   // the disk is full or cannot be written
    kRecordingDrops,    // frame sets came faster than they could be written
    kReplay,            // a recording takes the cameras' place, or gives it back
    kError,
};

struct Event {
    EventKind kind{};
    std::uint64_t sequence = 0;
    std::int64_t time_ns = 0;
    std::string camera;   // the camera's name where one is concerned
    std::string message;  // one line for people
};

struct FrameResult {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    FrameSet frame_set;                             // the pictures it came from
    std::vector<kernels::Silhouettes> silhouettes;  // per camera
    std::optional<SubjectTrack> subject;            // empty while nobody is tracked
    std::shared_ptr<const Volume> volume;           // coloured; null while nobody is tracked. Shared, so that
                                                    // a queued volume does not keep the pictures alive
    std::shared_ptr<const BodyPose> pose;           // null while nobody is tracked or no body fits
    std::vector<float> silhouette_iou;              // per camera, 0..1, NaN where there is nothing to compare
    std::vector<Event> events;
    StageTimes times;
};

using FrameResultPtr = std::shared_ptr<const FrameResult>;

}  // namespace kinevox
