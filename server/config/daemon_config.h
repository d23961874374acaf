// The daemon's configuration file; deploy/kinevoxd.toml documents every key. A part that has options of its
// own lists them beside their defaults (kernels/option_list.h); the rest is here.
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
#include "kernels/segmentation.h"
#include "server/pipeline/tracking/tracker.h"
#include "server/pose/pose_options.h"

namespace kinevox {

struct PipelineOptions;

// The motions of the virtual studio.
inline constexpr std::array<std::string_view, 6> kStudioMotions{"walk",  "run",          "sprint_start",
                                                                "squat", "jumping_jack", "arm_raise"};

struct ServerConfig {
    std::string listen = "127.0.0.1:50770";  // HOST:PORT; port 0 takes a free one
    AccessConfig access;
    bool operator==(const ServerConfig&) const = default;
};

struct StudioConfig {
    std::string motion = "walk";          // one of kStudioMotions
    int camera_count = 4;                 // 2 to 64
    int width_px = 640, height_px = 480;  // 64 to 4096
    double fps = 30;
    std::uint32_t seed = 1;  // of the subject, the room and the sensors' noise
    double stature_m = 0;    // 1.2 to 2.2; 0: drawn from the seed
    bool operator==(const StudioConfig&) const = default;
};

struct SourceConfig {
    enum class Kind { kStudio, kSession, kCameras };
    enum class Pacing { kRealTime, kAsFastAsPossible };
    Kind kind = Kind::kStudio;
    std::filesystem::path session_file;  // absolute after reading; for Kind::kSession
    Pacing pacing = Pacing::kRealTime;
    bool loop = true;       // restart after the last frame set
    bool autostart = true;  // capture from the daemon's start
    StudioConfig studio;
    LiveSourceConfig cameras;  // for Kind::kCameras
    bool operator==(const SourceConfig&) const = default;
};

struct PipelineConfig {
    enum class Device { kCpu, kCuda };
    Device device = Device::kCpu;
    double voxel_mm = 10;  // 2 to 100
    bool colouring = true;
    int threads = 0;  // of the compute pool; 0: one per core
    bool operator==(const PipelineConfig&) const = default;
};

struct SegmentationConfig {
    kernels::SegmentationOptions options;
    // Stores the background of live cameras, absolute; empty: off; not given: in the state folder.
    std::optional<std::filesystem::path> background_folder;
    bool operator==(const SegmentationConfig&) const = default;
};

struct PoseConfig {
    bool enabled = true;              // false: stop at the volume
    PoseStageOptions options;         // its body stays the default: body_file is read by pipeline_options()
    std::filesystem::path body_file;  // absolute; empty: an adult of average build
    bool auto_fit_body = true;        // without a body_file
    // Stores a body fitted on request, absolute; empty: off; not given: in the state folder.
    std::optional<std::filesystem::path> fitted_body_file;
    // Absolute; empty: no database; not given: in the state folder.
    std::optional<std::filesystem::path> database_file;
    int library_pose_count = 1400;  // 1 to 4000
    bool operator==(const PoseConfig&) const = default;
};

struct CalibrationConfig {
    // Stores calibrations, absolute; empty: off; not given: in the state folder.
    std::optional<std::filesystem::path> folder;
    bool operator==(const CalibrationConfig&) const = default;
};

struct RecordingConfig {
    // Stores recordings, absolute; empty: off; not given: in the state folder.
    std::optional<std::filesystem::path> folder;
    std::string codec = "utvideo";  // ffv1, utvideo or h264
    bool save_poses = true, save_volumes = true;
    double max_buffer_s = 0;  // length of the rolling buffer; 0: none
    int max_buffer_mb = 1024;
    int max_queue_mb = 256;      // not yet written; above it frame sets are dropped
    int min_free_disk_mb = 512;  // below it a recording ends
    double retention_days = 0;   // older recordings are deleted; 0: none
    double max_total_gb = 0;     // above it the oldest are deleted; 0: none
    bool operator==(const RecordingConfig&) const = default;
};

struct ReplayConfig {
    // Folders below which sessions may be replayed, besides the recordings'; absolute.
    std::vector<std::filesystem::path> folders;
    bool operator==(const ReplayConfig&) const = default;
};

struct StreamConfig {
    int max_lossless_messages = 256;  // queued for one lossless subscriber before its stream ends
    int max_lossless_mb = 32;
    double max_latest_messages_per_s =
        0;  // of all latest-only subscribers together; 0: by the number of cores
    int default_preview_width_px = 320;
    int default_preview_jpeg_quality = 80;  // 1 to 100
    bool operator==(const StreamConfig&) const = default;
};

struct ControlConfig {
    double default_lease_s = 30;
    double max_lease_s = 3600;
    bool operator==(const ControlConfig&) const = default;
};

struct MetricsConfig {
    std::string listen;  // HOST:PORT of the Prometheus endpoint; empty: off
    bool operator==(const MetricsConfig&) const = default;
};

struct LogConfig {
    std::string level = "info";  // trace, debug, info, warning, error or off
    std::filesystem::path file;  // absolute after reading; empty: standard error only
    bool operator==(const LogConfig&) const = default;
};

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
