#include "server/api/to_proto.h"

#include <absl/strings/ascii.h>

#include "common/one_line.h"
#include "common/proto_time.h"

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
    out.set_name(track.name);
    out.set_centre_std_m(track.centre_std_m);
    for (std::size_t i = 0; i < track.used_cameras.size() && i < cameras.size(); ++i)
        if (track.used_cameras[i]) out.add_used_cameras(cameras[i].name);
    return out;
}

v1::TimestampSource to_proto(TimestampSource source) {
    switch (source) {
        case TimestampSource::kUnknown:
            return v1::TIMESTAMP_SOURCE_UNSPECIFIED;
        case TimestampSource::kArrival:
            return v1::TIMESTAMP_SOURCE_ARRIVAL;
        case TimestampSource::kDevice:
            return v1::TIMESTAMP_SOURCE_DEVICE;
        case TimestampSource::kPtp:
            return v1::TIMESTAMP_SOURCE_PTP;
    }
    return v1::TIMESTAMP_SOURCE_UNSPECIFIED;
}

v1::CameraConnection to_proto(const CameraConnection& connection) {
    v1::CameraConnection out;
    out.set_connected(connection.connected);
    out.set_device(connection.device);
    out.set_error_message(connection.error_message);
    out.set_timestamp_source(to_proto(connection.timestamp_source));
    out.set_image_count(connection.image_count);
    out.set_lost_image_count(connection.lost_image_count);
    out.set_incomplete_image_count(connection.incomplete_image_count);
    out.set_late_image_count(connection.late_image_count);
    out.set_unmatched_image_count(connection.unmatched_image_count);
    out.set_warmup_image_count(connection.warmup_image_count);
    out.set_disconnect_count(connection.disconnect_count);
    out.set_missing_packet_count(connection.missing_packet_count);
    out.set_resent_packet_count(connection.resent_packet_count);
    out.set_resend_request_count(connection.resend_request_count);
    out.set_buffer_underrun_count(connection.buffer_underrun_count);
    out.set_packet_size_bytes(connection.packet_size_bytes);
    out.set_mean_skew_ms(connection.mean_skew_ms);
    out.set_max_abs_skew_ms(connection.max_abs_skew_ms);
    out.set_mean_arrival_delay_ms(connection.mean_arrival_delay_ms);
    out.set_max_arrival_delay_ms(connection.max_arrival_delay_ms);
    out.set_clock_drift_ppm(connection.clock_drift_ppm);
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
            return v1::CAPTURE_STATE_LEARNING_BACKGROUND;
        case RunState::kEnded:
            return v1::CAPTURE_STATE_SOURCE_ENDED;
        case RunState::kFailed:
            return v1::CAPTURE_STATE_FAILED;
    }
    return v1::CAPTURE_STATE_UNSPECIFIED;
}

v1::EventKind to_proto(EventKind kind) {
    // The table of kinds has the API's names in lower case.
    std::string name = "EVENT_KIND_";
    for (const char c : event_name(kind)) name += static_cast<char>(c >= 'a' && c <= 'z' ? c - 'a' + 'A' : c);
    v1::EventKind out = v1::EVENT_KIND_UNSPECIFIED;
    v1::EventKind_Parse(name, &out);
    return out;
}

v1::WatchEventsResponse to_proto(const PublishedEvent& published, std::uint64_t missed_count) {
    v1::WatchEventsResponse out;
    v1::Event& event = *out.mutable_event();
    event.set_event_id(published.id);
    event.set_kind(to_proto(published.event.kind));
    *event.mutable_event_time() = to_timestamp(published.time_utc_ns);
    event.set_sequence(published.event.sequence);
    event.set_camera(published.event.camera);
    event.set_subject_id(published.subject_id);
    event.set_message(published.event.message);
    out.set_missed_count(missed_count);
    return out;
}

grpc::Status to_grpc(const absl::Status& status) {
    // Messages quote requests. One line, short enough for a call's trailer of 8 kB after escaping.
    constexpr std::size_t kMaxMessageBytes = 2000;
    return {static_cast<grpc::StatusCode>(status.code()),
            one_line(std::string(status.message().substr(0, kMaxMessageBytes)))};
}

}  // namespace kinevox
