#include "server/config/daemon_config.h"

namespace kinevox {

std::span<const RenamedKey> renamed_config_keys() {
    static constexpr RenamedKey kRenamed[] = {
        {"server.certificate", "server.tls_certificate_file"},
        {"server.key", "server.tls_key_file"},
        {"server.client_ca", "server.tls_client_ca_file"},
        {"server.tokens", "server.token_file"},
        {"server.audit", "server.audit_file"},
        {"server.limits.max_message_mb", "server.limits.max_request_mb"},
        {"server.limits.requests_per_s", "server.limits.max_requests_per_s"},
        {"source.session", "source.session_file"},
        {"source.studio.cameras", "source.studio.camera_count"},
        {"source.studio.width", "source.studio.width_px"},
        {"source.studio.height", "source.studio.height_px"},
        {"source.studio.subject_height_m", "source.studio.stature_m"},
        {"source.cameras.calibration", "source.cameras.calibration_file"},
        {"source.cameras.trigger_line", "source.cameras.trigger_input_line"},
        {"source.cameras.master", "source.cameras.trigger_camera"},
        {"source.cameras.master_line", "source.cameras.trigger_output_line"},
        {"source.cameras.tolerance_ms", "source.cameras.match_tolerance_ms"},
        {"source.cameras.longest_wait_ms", "source.cameras.max_wait_ms"},
        {"source.cameras.least_cameras", "source.cameras.min_cameras"},
        {"source.cameras.queue", "source.cameras.max_queued_frame_sets"},
        {"source.cameras.packet_bytes", "source.cameras.packet_size_bytes"},
        {"source.cameras.offset_px", "source.cameras.sensor_offset_px"},
        {"source.cameras.camera.offset_px", "source.cameras.camera.sensor_offset_px"},
        {"segmentation.samples", "segmentation.background_samples"},
        {"segmentation.stored_background", "segmentation.background_folder"},
        {"tracking.confirm_frames", "tracking.confirm_s"},
        {"pose.body", "pose.body_file"},
        {"pose.fit_body", "pose.auto_fit_body"},
        {"pose.fitted_body", "pose.fitted_body_file"},
        {"pose.database", "pose.database_file"},
        {"pose.database_poses", "pose.library_pose_count"},
        {"recording.poses", "recording.save_poses"},
        {"recording.volumes", "recording.save_volumes"},
        {"recording.keep_last_s", "recording.max_buffer_s"},
        {"recording.keep_last_mb", "recording.max_buffer_mb"},
        {"recording.queue_mb", "recording.max_queue_mb"},
        {"recording.least_free_mb", "recording.min_free_disk_mb"},
        {"recording.keep_days", "recording.retention_days"},
        {"recording.keep_gb", "recording.max_total_gb"},
        {"stream.lossless_max_messages", "stream.max_lossless_messages"},
        {"stream.lossless_max_mb", "stream.max_lossless_mb"},
        {"stream.newest_per_s", "stream.max_latest_messages_per_s"},
        {"stream.preview_width_px", "stream.default_preview_width_px"},
        {"stream.preview_jpeg_quality", "stream.default_preview_jpeg_quality"},
        {"control.lease_timeout_s", "control.default_lease_s"},
        {"control.longest_lease_timeout_s", "control.max_lease_s"},
    };
    return kRenamed;
}

}  // namespace kinevox
