// The daemon's configuration file; deploy/kinevoxd.toml documents every key. Options are listed once, beside
// their defaults (kernels/option_list.h): those of a part by the part, the others here. Only regions, points
// and the cameras' own tables are read by hand.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/access_config.h"
#include "common/live_camera_config.h"
#include "common/toml_reader.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/option_list.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/cameras/studio/motion_names.h"
#include "server/pipeline/tracking/tracker.h"
#include "server/pose/pose_options.h"

namespace kinevox {

struct PipelineOptions;

// Paths of the configuration are absolute after reading. Of a path that is not given, the default is in the
// state folder if it is optional, else it is empty; an empty one switches off what it stores.
using OptionalPath = std::optional<std::filesystem::path>;

struct ServerConfig {
    std::string listen = "127.0.0.1:50770";
    AccessConfig access;
    bool operator==(const ServerConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, ServerConfig>
void visit_options(T& o, F&& f) {
    using kernels::text_option;
    f(text_option("listen", "HOST:PORT of the gRPC server."), o.listen);
    f(text_option("tls_certificate_file", "TLS certificate with its chain, and its key, PEM."),
      o.access.tls_certificate_file);
    f(text_option("tls_key_file", "TLS certificate with its chain, and its key, PEM."),
      o.access.tls_key_file);
    f(text_option("tls_client_ca_file",
                  "Require client certificates of this authority, in addition to tokens."),
      o.access.tls_client_ca_file);
    f(text_option("token_file", "Access tokens and roles, managed by `kinevox token`."), o.access.token_file);
    f(text_option("audit_file", "Audit log: one JSON line per operating or refused call."),
      o.access.audit_file);
}

// [server.limits]
template <typename T, typename F>
requires kernels::SameOptions<T, AccessConfig>
void visit_options(T& o, F&& f) {
    f({"max_request_mb", 1, 1024, "MB", "Maximum size of a request, which may contain a BVH file."},
      o.max_request_mb);
    f({"max_streams", 1, 100000, "", "Maximum number of open streams of all clients together."},
      o.max_streams);
    f({"max_streams_per_token", 1, 100000, "", "Maximum number of open streams per token."},
      o.max_streams_per_token);
    f({"max_requests_per_s", 1, 1e6, "1/s", "Maximum rate of requests per token, also the burst size."},
      o.max_requests_per_s);
    f({"handshake_timeout_s", 1, 300, "s", "Time limit for the connection handshake."},
      o.handshake_timeout_s);
}

struct StudioConfig {
    std::string motion = "walk";
    int camera_count = 4;
    int width_px = 640, height_px = 480;
    double fps = 30;
    std::uint32_t seed = 1;
    double stature_m = 0;
    bool operator==(const StudioConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, StudioConfig>
void visit_options(T& o, F&& f) {
    f(kernels::text_option("motion", "Motion of the subject.", studio::kMotionNames), o.motion);
    f({"camera_count", 2, 64, "", "Number of cameras around the subject."}, o.camera_count);
    f({"width_px", 64, 4096, "px", "Width of their images."}, o.width_px);
    f({"height_px", 64, 4096, "px", "Height of their images."}, o.height_px);
    f({"fps", 1, 1000, "Hz", "Frame sets per second."}, o.fps);
    f({"seed", 0, 0xffffffff, "", "Seed of the subject, the room and the sensor noise."}, o.seed);
    f({"stature_m", 0, 2.2, "m", "Stature of the subject, at least 1.2; 0: drawn from the seed."},
      o.stature_m);
}

inline constexpr std::array<std::string_view, 4> kTriggers{"free_run", "software", "external", "camera"};

// [source.cameras]
template <typename T, typename F>
requires kernels::SameOptions<T, LiveSourceConfig>
void visit_options(T& o, F&& f) {
    using kernels::text_option;
    f(text_option("calibration_file", "Calibration with the name of each camera."), o.calibration_file);
    f(text_option("trigger", "Synchronisation of the exposures.", kTriggers), o.trigger);
    f(text_option("trigger_input_line", "Input line that triggers a camera."), o.trigger_input_line);
    f(text_option("trigger_camera", "Camera that triggers the others."), o.trigger_camera);
    f(text_option("trigger_output_line", "Output line of trigger_camera."), o.trigger_output_line);
    f({"fps", 1, 1000, "Hz",
       "Images per second of each camera; for trigger = \"external\" those of the generator."},
      o.fps);
    f({"ptp", 0, 1, "",
       "Enable IEEE 1588 where a camera supports it, so that timestamps are compared directly."},
      o.ptp);
    f({"match_tolerance_ms", 0, 1000, "ms",
       "Maximum time difference within a frame set; 0: half a frame period, for trigger = \"free_run\" "
       "0.9 of it."},
      o.match_tolerance_ms);
    f({"max_wait_ms", 1, 5000, "ms", "Maximum wait for missing images."}, o.max_wait_ms);
    f({"min_cameras", 1, 64, "", "Minimum number of images in a frame set."}, o.min_cameras);
    f({"max_queued_frame_sets", 1, 64, "", "Queue length; when full, the oldest frame set is dropped."},
      o.max_queued_frame_sets);
    f({"packet_resend", 0, 1, "", "Request lost packets again."}, o.packet_resend);
    f({"packet_size_bytes", 0, 16000, "bytes",
       "Size of GigE Vision packets, at least 576; 0: the largest that arrives."},
      o.packet_size_bytes);
}

inline constexpr std::array<std::string_view, 3> kSourceKinds{"studio", "session", "cameras"};
inline constexpr std::array<std::string_view, 2> kPacings{"real_time", "as_fast_as_possible"};

struct SourceConfig {
    enum class Kind { kStudio, kSession, kCameras };
    enum class Pacing { kRealTime, kAsFastAsPossible };
    Kind kind = Kind::kStudio;
    std::filesystem::path session_file;  // for Kind::kSession
    Pacing pacing = Pacing::kRealTime;
    bool loop = true;
    bool autostart = true;
    StudioConfig studio;
    LiveSourceConfig cameras;  // for Kind::kCameras
    bool operator==(const SourceConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, SourceConfig>
void visit_options(T& o, F&& f) {
    using kernels::text_option;
    f(text_option("kind", "Image source.", kSourceKinds), o.kind);
    f(text_option("session_file", "session.toml of the recorded session."), o.session_file);
    f(text_option("pacing", "Playback of a session.", kPacings), o.pacing);
    f({"loop", 0, 1, "", "Restart after the last frame set."}, o.loop);
    f({"autostart", 0, 1, "", "Start capturing when the daemon starts; false: wait for `kinevox start`."},
      o.autostart);
}

struct PipelineConfig {
    kernels::Device device;
    double voxel_mm = 10;
    bool colouring = true;
    int threads = 0;
    bool operator==(const PipelineConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, PipelineConfig>
void visit_options(T& o, F&& f) {
    f(kernels::text_option("device", "Where images are segmented and volumes carved."), o.device);
    f({"voxel_mm", 2, 100, "mm", "Voxel edge; halving it takes about four times as long."}, o.voxel_mm);
    f({"colouring", 0, 1, "", "Photo-consistency carving and colouring."}, o.colouring);
    f({"threads", 0, 1024, "", "Compute threads; 0: one per core."}, o.threads);
}

struct SegmentationConfig {
    kernels::SegmentationOptions options;
    bool auto_judge_faint = true;
    OptionalPath background_folder;
    bool operator==(const SegmentationConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, SegmentationConfig>
void visit_options(T& o, F&& f) {
    f({"auto_judge_faint", 0, 1, "",
       "Without judge_faint: try it live where the posed body does not fit the silhouettes, keep it where it "
       "helps."},
      o.auto_judge_faint);
    f(kernels::text_option(
          "background_folder",
          "Folder that stores the background learned from live cameras, for the next start."),
      o.background_folder);
}

struct PoseConfig {
    bool enabled = true;
    PoseStageOptions options;         // its body stays the default: body_file is read by pipeline_options()
    std::filesystem::path body_file;  // empty: an adult of average build
    bool auto_fit_body = true;
    OptionalPath fitted_body_file;
    OptionalPath database_file;
    int library_pose_count = 1400;
    bool operator==(const PoseConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, PoseConfig>
void visit_options(T& o, F&& f) {
    f({"enabled", 0, 1, "", "Joints and angles; false: the capture stops at the volume."}, o.enabled);
    f({"auto_fit_body", 0, 1, "",
       "Without body_file: fit a body to each person from the first frame sets on, and again to the first "
       "six seconds, in the background."},
      o.auto_fit_body);
    using kernels::text_option;
    f(text_option("body_file",
                  "Body of the subject, fitted by `kinevox process` or by the "
                  "daemon."),
      o.body_file);
    f(text_option("fitted_body_file",
                  "File for the last body fitted on request; used when the daemon starts."),
      o.fitted_body_file);
    f(text_option("database_file", "Pose database, which finds a body that is not tracked yet."),
      o.database_file);
    f({"library_pose_count", 1, 4000, "", "Number of library poses."}, o.library_pose_count);
}

struct CalibrationConfig {
    OptionalPath folder;
    bool operator==(const CalibrationConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, CalibrationConfig>
void visit_options(T& o, F&& f) {
    f(kernels::text_option("folder", "Folder that stores calibrations and which of them is active."),
      o.folder);
}

inline constexpr std::array<std::string_view, 3> kCodecs{"ffv1", "utvideo", "h264"};

struct RecordingConfig {
    OptionalPath folder;
    std::string codec = "utvideo";
    bool save_poses = true, save_volumes = true;
    double max_buffer_s = 0;
    int max_buffer_mb = 1024;
    int max_queue_mb = 256;
    int min_free_disk_mb = 512;
    double retention_days = 0;
    double max_total_gb = 0;
    bool operator==(const RecordingConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, RecordingConfig>
void visit_options(T& o, F&& f) {
    using kernels::text_option;
    f(text_option("folder", "Folder that stores recordings, one folder each."), o.folder);
    f(text_option("codec", "Video codec.", kCodecs), o.codec);
    f({"save_poses", 0, 1, "", "Store the poses with the images."}, o.save_poses);
    f({"save_volumes", 0, 1, "", "Store the volumes with the images."}, o.save_volumes);
    f({"max_buffer_s", 0, 3600, "s",
       "Length of the rolling buffer that `kinevox record save` writes; 0: none."},
      o.max_buffer_s);
    f({"max_buffer_mb", 1, 1 << 20, "MB", "Memory of the rolling buffer."}, o.max_buffer_mb);
    f({"max_queue_mb", 1, 1 << 20, "MB", "Memory for images that are not written yet."}, o.max_queue_mb);
    f({"min_free_disk_mb", 0, 1 << 20, "MB",
       "Minimum free space: below it a recording ends and none starts."},
      o.min_free_disk_mb);
    f({"retention_days", 0, 36500, "d",
       "Age above which recordings are deleted with all their files; 0: none."},
      o.retention_days);
    f({"max_total_gb", 0, 1e6, "GB", "Size of all recordings above which the oldest are deleted; 0: none."},
      o.max_total_gb);
}

struct ReplayConfig {
    // Folders below which sessions may be replayed, besides the recordings'.
    std::vector<std::filesystem::path> folders;
    bool operator==(const ReplayConfig&) const = default;
};

struct StreamConfig {
    int max_lossless_messages = 256;
    int max_lossless_mb = 32;
    double max_latest_messages_per_s = 0;
    int default_preview_width_px = 320;
    int default_preview_jpeg_quality = 80;
    bool operator==(const StreamConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, StreamConfig>
void visit_options(T& o, F&& f) {
    f({"max_lossless_messages", 1, 100000, "",
       "Messages queued for one lossless subscriber before its stream ends."},
      o.max_lossless_messages);
    f({"max_lossless_mb", 1, 4096, "MB", "Memory queued for one lossless subscriber before its stream ends."},
      o.max_lossless_mb);
    f({"max_latest_messages_per_s", 0, 1e9, "1/s",
       "Total rate of latest-only messages, shared equally by all subscribers; 0: 16000 per core."},
      o.max_latest_messages_per_s);
    f({"default_preview_width_px", 16, 8192, "px", "Width of previews whose subscriber requests none."},
      o.default_preview_width_px);
    f({"default_preview_jpeg_quality", 1, 100, "",
       "JPEG quality of previews whose subscriber requests none."},
      o.default_preview_jpeg_quality);
}

struct ControlConfig {
    double default_lease_s = 30;
    double max_lease_s = 3600;
    bool operator==(const ControlConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, ControlConfig>
void visit_options(T& o, F&& f) {
    f({"default_lease_s", 1, 86400, "s", "Default control lease without renewal."}, o.default_lease_s);
    f({"max_lease_s", 1, 86400, "s", "Maximum control lease without renewal."}, o.max_lease_s);
}

struct MetricsConfig {
    std::string listen;  // empty: off
    bool operator==(const MetricsConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, MetricsConfig>
void visit_options(T& o, F&& f) {
    f(kernels::text_option(
          "listen",
          "HOST:PORT of the Prometheus endpoint, at /metrics over plain HTTP without authentication."),
      o.listen);
}

inline constexpr std::array<std::string_view, 6> kLogLevels{"trace",   "debug", "info",
                                                            "warning", "error", "off"};

struct LogConfig {
    std::string level = "info";
    std::filesystem::path file;  // empty: standard error only
    bool operator==(const LogConfig&) const = default;
};

template <typename T, typename F>
requires kernels::SameOptions<T, LogConfig>
void visit_options(T& o, F&& f) {
    f(kernels::text_option("level", "Lowest level that is logged.", kLogLevels), o.level);
    f(kernels::text_option("file", "Also log to this file."), o.file);
}

struct DaemonConfig {
    ServerConfig server;
    SourceConfig source;
    PipelineConfig pipeline;
    SegmentationConfig segmentation;
    TrackerOptions tracking;
    kernels::HullOptions hull;
    kernels::ColouringOptions colouring;
    PoseConfig pose;
    CalibrationConfig calibration;
    RecordingConfig recording;
    ReplayConfig replay;
    StreamConfig stream;
    ControlConfig control;
    MetricsConfig metrics;
    LogConfig log;
    bool operator==(const DaemonConfig&) const = default;
};

// Calls f(TABLE, options) for each table of the file whose options are listed above; those of the pipeline's
// parts are in visit_option_tables().
template <typename T, typename F>
requires kernels::SameOptions<T, DaemonConfig>
void visit_config_tables(T& config, F&& f) {
    f("server", config.server);
    f("server.limits", config.server.access);
    f("source", config.source);
    f("source.studio", config.source.studio);
    f("source.cameras", config.source.cameras);
    f("pipeline", config.pipeline);
    f("segmentation", config.segmentation);
    f("pose", config.pose);
    f("calibration", config.calibration);
    f("recording", config.recording);
    f("stream", config.stream);
    f("control", config.control);
    f("metrics", config.metrics);
    f("log", config.log);
}

// Keys that were renamed before version 1; one in a file is an error that names the new one.
std::span<const RenamedKey> renamed_config_keys();

// Paths are resolved against the file's folder. Errors are one line with file, line, key, value and remedy:
// NotFound for a file that is missing, InvalidArgument for all else. Every key has the default above.
absl::StatusOr<DaemonConfig> read_config(const std::filesystem::path& file, bool check_files_exist = true);
absl::StatusOr<DaemonConfig> parse_config_toml(const std::string& text, const std::filesystem::path& folder,
                                               const std::string& name_for_errors, bool check_files_exist);

// What the pipeline does by the configuration, with the body of [pose] body_file. For the daemon and for
// `kinevox process --config`.
absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config);

// Empty if `text` is HOST:PORT ([HOST]:PORT with IPv6), else what is wrong with it.
std::string listen_address_problem(std::string_view text);

}  // namespace kinevox
