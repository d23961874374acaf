// What can happen to a capture, its cameras, recordings and control, and one table with the names and levels.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>

namespace kinevox {

enum class EventKind : std::uint8_t {
    kSubjectFound,
    kSubjectLost,
    kCameraExcluded,  // its silhouette is inconsistent with the other cameras'
    kCameraIncluded,  // it is consistent again
    kCameraNoImage,   // it delivered no image for a frame set
    kCameraResumed,   // it delivers images again
    kBackgroundLearned,
    kCaptureStarted,
    kCaptureStopped,
    kSourceEnded,
    kControlAcquired,
    kControlReleased,    // by the operator, or because the lease expired
    kPoseDatabaseReady,  // read from its file or built
    kBodyFitted,
    kCameraMoved,  // the static scene has shifted: its calibration is suspect
    kCameraMoveCleared,
    kCalibrationChanged,  // solved, imported, applied, undone or deleted
    kCameraDisconnected,
    kCameraReconnected,
    kCameraImagesLost,  // images were lost between camera and host
    kRecordingStarted,
    kRecordingStopped,        // on request or with the capture
    kRecordingFailed,         // the disk is full or not writable
    kRecordingFramesDropped,  // frame sets arrive faster than they are written
    kReplayOpened,
    kReplayClosed,
    kClockStepped,         // the system clock was set while capturing
    kGpuFailed,            // the CPU computes from now on
    kSegmentationChanged,  // by itself: silhouettes lacked parts of the subject
    kError,
};

enum class EventLevel : std::uint8_t { kInfo, kWarning, kError };

struct EventKindInfo {
    EventKind kind;
    // As in events.csv, the journal and JSON; in upper case with the prefix EVENT_KIND_ the name in the API.
    std::string_view name;
    EventLevel level;
};

// One row per kind, in the order of the enum.
inline constexpr std::array kEventKinds{
    EventKindInfo{EventKind::kSubjectFound, "subject_found", EventLevel::kInfo},
    EventKindInfo{EventKind::kSubjectLost, "subject_lost", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraExcluded, "camera_excluded", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraIncluded, "camera_included", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraNoImage, "camera_no_image", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraResumed, "camera_resumed", EventLevel::kInfo},
    EventKindInfo{EventKind::kBackgroundLearned, "background_learned", EventLevel::kInfo},
    EventKindInfo{EventKind::kCaptureStarted, "capture_started", EventLevel::kInfo},
    EventKindInfo{EventKind::kCaptureStopped, "capture_stopped", EventLevel::kInfo},
    EventKindInfo{EventKind::kSourceEnded, "source_ended", EventLevel::kInfo},
    EventKindInfo{EventKind::kControlAcquired, "control_acquired", EventLevel::kInfo},
    EventKindInfo{EventKind::kControlReleased, "control_released", EventLevel::kInfo},
    EventKindInfo{EventKind::kPoseDatabaseReady, "pose_database_ready", EventLevel::kInfo},
    EventKindInfo{EventKind::kBodyFitted, "body_fitted", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraMoved, "camera_moved", EventLevel::kWarning},
    EventKindInfo{EventKind::kCameraMoveCleared, "camera_move_cleared", EventLevel::kInfo},
    EventKindInfo{EventKind::kCalibrationChanged, "calibration_changed", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraDisconnected, "camera_disconnected", EventLevel::kWarning},
    EventKindInfo{EventKind::kCameraReconnected, "camera_reconnected", EventLevel::kInfo},
    EventKindInfo{EventKind::kCameraImagesLost, "camera_images_lost", EventLevel::kWarning},
    EventKindInfo{EventKind::kRecordingStarted, "recording_started", EventLevel::kInfo},
    EventKindInfo{EventKind::kRecordingStopped, "recording_stopped", EventLevel::kInfo},
    EventKindInfo{EventKind::kRecordingFailed, "recording_failed", EventLevel::kError},
    EventKindInfo{EventKind::kRecordingFramesDropped, "recording_frames_dropped", EventLevel::kWarning},
    EventKindInfo{EventKind::kReplayOpened, "replay_opened", EventLevel::kInfo},
    EventKindInfo{EventKind::kReplayClosed, "replay_closed", EventLevel::kInfo},
    EventKindInfo{EventKind::kClockStepped, "clock_stepped", EventLevel::kError},
    EventKindInfo{EventKind::kGpuFailed, "gpu_failed", EventLevel::kError},
    EventKindInfo{EventKind::kSegmentationChanged, "segmentation_changed", EventLevel::kInfo},
    EventKindInfo{EventKind::kError, "error", EventLevel::kError},
};

constexpr const EventKindInfo& event_info(EventKind kind) {
    return kEventKinds[static_cast<std::size_t>(kind)];
}
constexpr std::string_view event_name(EventKind kind) {
    return event_info(kind).name;
}

static_assert([] {
    for (std::size_t i = 0; i < kEventKinds.size(); ++i)
        if (static_cast<std::size_t>(kEventKinds[i].kind) != i) return false;
    return kEventKinds.size() == static_cast<std::size_t>(EventKind::kError) + 1;
}());

struct Event {
    EventKind kind{};
    std::uint64_t sequence = 0;    // of the frame set concerned, 0 for none
    std::int64_t time_ns = 0;      // capture time where a frame set is concerned
    std::string camera;            // its name where a camera is concerned
    std::string message;           // one line for people
    std::uint32_t subject_id = 0;  // of the subject concerned, 0 for none
};

}  // namespace kinevox
