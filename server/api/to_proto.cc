#include "server/api/to_proto.h"

#include "common/one_line.h"

namespace kinevox {

v1::Vec3 to_proto(const Vec3& vector) {
    v1::Vec3 out;
    out.set_x(vector.x);
    out.set_y(vector.y);
    out.set_z(vector.z);
    return out;
}

v1::Camera to_proto(const Camera& camera) {
    v1::Camera out;
    out.set_name(camera.name);
    out.set_width_px(camera.width);
    out.set_height_px(camera.height);
    out.set_fx_px(camera.fx);
    out.set_fy_px(camera.fy);
    out.set_cx_px(camera.cx);
    out.set_cy_px(camera.cy);
    for (const double k : {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3}) out.add_distortion(k);
    for (const double r : camera.camera_from_world.rotation.m) out.add_rotation_camera_from_world(r);
    *out.mutable_translation_camera_from_world() = to_proto(camera.camera_from_world.translation);
    return out;
}

v1::StageTimes to_proto(const StageTimes& times) {
    v1::StageTimes out;
    out.set_decode_ms(times.decode_ms);
    out.set_segmentation_ms(times.segmentation_ms);
    out.set_tracking_ms(times.tracking_ms);
    out.set_hull_ms(times.hull_ms);
    out.set_colouring_ms(times.colouring_ms);
    out.set_pose_ms(times.pose_ms);
    out.set_total_ms(times.total_ms);
    return out;
}

v1::Subject to_proto(const SubjectTrack& track, const std::vector<Camera>& cameras) {
    v1::Subject out;
    out.set_subject_id(track.subject_id);
    *out.mutable_centre_in_world() = to_proto(track.centre_in_world);
    *out.mutable_velocity_in_world() = to_proto(track.velocity_in_world);
    out.set_centre_std_m(track.centre_std_m);
    for (std::size_t i = 0; i < track.camera_used.size() && i < cameras.size(); ++i)
        if (track.camera_used[i]) out.add_cameras_used(cameras[i].name);
    return out;
}

v1::CameraLink to_proto(const CameraLink& link) {
    v1::CameraLink out;
    out.set_connected(link.connected);
    out.set_device(link.device);
    out.set_problem(link.problem);
    switch (link.clock) {
        case CameraClock::kUnknown:
            out.set_clock(v1::CAMERA_CLOCK_UNSPECIFIED);
            break;
        case CameraClock::kArrival:
            out.set_clock(v1::CAMERA_CLOCK_ARRIVAL);
            break;
        case CameraClock::kDevice:
            out.set_clock(v1::CAMERA_CLOCK_DEVICE);
            break;
        case CameraClock::kPtp:
            out.set_clock(v1::CAMERA_CLOCK_PTP);
            break;
    }
    out.set_pictures(link.pictures);
    out.set_lost(link.lost);
    out.set_incomplete(link.incomplete);
    out.set_late(link.late);
    out.set_unmatched(link.unmatched);
    out.set_settling(link.settling);
    out.set_disconnects(link.disconnects);
    out.set_packets_missing(link.packets_missing);
    out.set_packets_resent(link.packets_resent);
    out.set_resend_requests(link.resend_requests);
    out.set_underruns(link.underruns);
    out.set_packet_bytes(link.packet_bytes);
    out.set_skew_ms(link.skew_ms);
    out.set_skew_max_ms(link.skew_max_ms);
    out.set_lateness_ms(link.lateness_ms);
    out.set_lateness_max_ms(link.lateness_max_ms);
    out.set_clock_drift_ppm(link.clock_drift_ppm);
    return out;
}

v1::CaptureState to_proto(RunState state) {
    switch (state) {
        case RunState::kStopped:
            return v1::CAPTURE_STATE_STOPPED;
        case RunState::kStarting:
            return v1::CAPTURE_STATE_STARTING;
        case RunState::kRunning:
            return v1::CAPTURE_STATE_RUNNING;
        case RunState::kLearning:
            return v1::CAPTURE_STATE_LEARNING;
        case RunState::kEnded:
            return v1::CAPTURE_STATE_ENDED;
        case RunState::kFailed:
            return v1::CAPTURE_STATE_FAILED;
    }
    return v1::CAPTURE_STATE_UNSPECIFIED;
}

v1::EventKind to_proto(EventKind kind) {
    switch (kind) {
        case EventKind::kSubjectFound:
            return v1::EVENT_KIND_SUBJECT_FOUND;
        case EventKind::kSubjectLost:
            return v1::EVENT_KIND_SUBJECT_LOST;
        case EventKind::kCameraLeftOut:
            return v1::EVENT_KIND_CAMERA_LEFT_OUT;
        case EventKind::kCameraBack:
            return v1::EVENT_KIND_CAMERA_BACK;
        case EventKind::kCameraSilent:
            return v1::EVENT_KIND_CAMERA_SILENT;
        case EventKind::kBackgroundLearned:
            return v1::EVENT_KIND_BACKGROUND_LEARNED;
        case EventKind::kStarted:
            return v1::EVENT_KIND_STARTED;
        case EventKind::kStopped:
            return v1::EVENT_KIND_STOPPED;
        case EventKind::kSourceEnded:
            return v1::EVENT_KIND_SOURCE_ENDED;
        case EventKind::kControlTaken:
            return v1::EVENT_KIND_CONTROL_TAKEN;
        case EventKind::kControlReleased:
            return v1::EVENT_KIND_CONTROL_RELEASED;
        case EventKind::kPoseDatabase:
            return v1::EVENT_KIND_POSE_DATABASE;
        case EventKind::kBodyFitted:
            return v1::EVENT_KIND_BODY_FITTED;
        case EventKind::kCameraMoved:
            return v1::EVENT_KIND_CAMERA_MOVED;
        case EventKind::kCameraInPlace:
            return v1::EVENT_KIND_CAMERA_IN_PLACE;
        case EventKind::kCalibration:
            return v1::EVENT_KIND_CALIBRATION;
        case EventKind::kCameraLost:
            return v1::EVENT_KIND_CAMERA_LOST;
        case EventKind::kCameraRejoined:
            return v1::EVENT_KIND_CAMERA_REJOINED;
        case EventKind::kCameraLosses:
            return v1::EVENT_KIND_CAMERA_LOSSES;
        case EventKind::kRecordingStarted:
            return v1::EVENT_KIND_RECORDING_STARTED;
        case EventKind::kRecordingStopped:
            return v1::EVENT_KIND_RECORDING_STOPPED;
        case EventKind::kRecordingFailed:
            return v1::EVENT_KIND_RECORDING_FAILED;
        case EventKind::kRecordingDrops:
            return v1::EVENT_KIND_RECORDING_DROPS;
        case EventKind::kReplay:
            return v1::EVENT_KIND_REPLAY;
        case EventKind::kError:
            return v1::EVENT_KIND_ERROR;
    }
    return v1::EVENT_KIND_UNSPECIFIED;
}

v1::WatchEventsResponse to_proto(const PublishedEvent& published, std::uint64_t missed) {
    v1::WatchEventsResponse out;
    out.set_event_number(published.number);
    out.set_kind(to_proto(published.event.kind));
    out.set_time_ns(published.time_utc_ns);
    out.set_sequence(published.event.sequence);
    out.set_camera(published.event.camera);
    out.set_message(published.event.message);
    out.set_missed(missed);
    out.set_subject_id(published.subject_id);
    return out;
}

grpc::Status to_grpc(const absl::Status& status) {
    // Messages quote what was sent. One line, and no more than goes into a call's trailer, of 8 kB with what
    // is escaped.
    constexpr std::size_t kLongest = 2000;
    return {static_cast<grpc::StatusCode>(status.code()),
            one_line(std::string(status.message().substr(0, kLongest)))};
}

}  // namespace kinevox
