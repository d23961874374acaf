// The daemon's configuration as it stands in its TOML file; deploy/kinevoxd.toml explains every key. Plain
// numbers: who owns a part turns them into that part's options.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "common/access_config.h"
#include "common/live_camera_config.h"

namespace kinevox {

// The motions that the virtual studio knows.
inline constexpr std::array<std::string_view, 6> kStudioMotions{"walk",  "run",          "sprint_start",
                                                                "squat", "jumping_jack", "arm_raise"};

struct ServerConfig {
    std::string listen = "127.0.0.1:50770";  // HOST:PORT; port 0 takes a free one
    AccessConfig access;
    bool operator==(const ServerConfig&) const = default;
};

struct StudioConfig {
    std::string motion = "walk";    // one of kStudioMotions
    int cameras = 4;                // 2 to 64
    int width = 640, height = 480;  // px
    double fps = 30;
    std::uint32_t seed = 1;       // of the subject, the room and the sensors' noise
    double subject_height_m = 0;  // 1.2 to 2.2; 0: drawn from the seed
    bool operator==(const StudioConfig&) const = default;
};

struct SourceConfig {
    enum class Kind { kStudio, kSession, kCameras };
    enum class Pacing { kRealTime, kAsFastAsPossible };
    Kind kind = Kind::kStudio;
    std::filesystem::path session;  // session.toml, absolute after reading; for Kind::kSession
    Pacing pacing = Pacing::kRealTime;
    bool loop = true;       // start again behind the last frame set
    bool autostart = true;  // capture from the daemon's start on, without waiting for an operator
    StudioConfig studio;
    LiveCamerasConfig cameras;  // for Kind::kCameras
    bool operator==(const SourceConfig&) const = default;
};

struct PipelineConfig {
    enum class Device { kCpu, kCuda };
    Device device = Device::kCpu;
    double voxel_mm = 10;  // 2 to 100
    bool colouring = true;
    int threads = 0;  // workers of the compute pool; 0: one a core
    bool operator==(const PipelineConfig&) const = default;
};

struct SegmentationConfig {
    int samples = 32;               // of the background per pixel, N
    double sharp_threshold = 0.5;   // foreground probability from which a pixel is in the sharp silhouette
    double loose_threshold = 0.15;  // and in the loose one; not above sharp_threshold
    // Folder where a background that live cameras showed is stored, absolute; empty: nowhere; not given: in
    // the user's folder.
    std::optional<std::filesystem::path> stored_background;
    bool operator==(const SegmentationConfig&) const = default;
};

struct PoseConfig {
    bool enabled = true;         // off: stop at the volume
    bool filtered = true;        // smooth poses over time, causally
    std::filesystem::path body;  // body.toml of the subject, absolute; empty: an adult of average build
    // Without a body: fit one to the first seconds in which somebody is seen.
    bool fit_body = true;
    // Where a body that was fitted on request is stored, absolute; empty: nowhere; not given: in the user's
    // folder.
    std::optional<std::filesystem::path> fitted_body;
    // The pose database's file, absolute; empty: no database; not given: in the user's folder for programs'
    // state.
    std::optional<std::filesystem::path> database;
    int database_poses = 1400;  // of our own library, 1 to 4000
    bool operator==(const PoseConfig&) const = default;
};

struct CalibrationConfig {
    // Where calibrations are stored, absolute; empty: nowhere; not given: in the user's folder for programs'
    // state.
    std::optional<std::filesystem::path> folder;
    bool operator==(const CalibrationConfig&) const = default;
};

struct RecordingConfig {
    // Where recordings are stored, absolute; empty: nowhere; not given: in the user's folder for programs'
    // state.
    std::optional<std::filesystem::path> folder;
    std::string codec = "utvideo";  // ffv1, utvideo or h264
    bool poses = true, volumes = true;
    double keep_last_s = 0;   // of the rolling buffer; 0: none
    int keep_last_mb = 1024;  // most that it may hold
    int queue_mb = 256;       // taken and not yet written; beyond it frame sets are dropped
    int min_free_mb = 512;    // on the disk, below which a recording ends
    double keep_days = 0;     // older ones are deleted; 0: none
    double keep_gb = 0;       // beyond it the oldest are deleted; 0: none
    bool operator==(const RecordingConfig&) const = default;
};

struct StreamConfig {
    int lossless_max_messages = 256;  // queued for one lossless subscriber before its stream ends
    int lossless_max_mb = 32;
    double newest_per_s = 0;  // messages to all together who want the newest only; 0: by the number of cores
    int preview_width_px = 320;     // where a subscriber asks for no size
    int preview_jpeg_quality = 80;  // where a subscriber asks for none, 1 to 100
    bool operator==(const StreamConfig&) const = default;
};

struct ControlConfig {
    double lease_timeout_s = 30;  // where an operator asks for none
    double max_lease_timeout_s = 3600;
    bool operator==(const ControlConfig&) const = default;
};

struct MetricsConfig {
    std::string listen;  // HOST:PORT to serve Prometheus on; empty: nowhere
    bool operator==(const MetricsConfig&) const = default;
};

struct LogConfig {
    std::string level = "info";  // trace, debug, info, warning, error or off
    std::filesystem::path file;  // absolute after reading; empty: standard error alone
    bool operator==(const LogConfig&) const = default;
};

struct DaemonConfig {
    ServerConfig server;
    SourceConfig source;
    PipelineConfig pipeline;
    SegmentationConfig segmentation;
    PoseConfig pose;
    CalibrationConfig calibration;
    RecordingConfig recording;
    StreamConfig stream;
    ControlConfig control;
    MetricsConfig metrics;
    LogConfig log;
    bool operator==(const DaemonConfig&) const = default;
};

// Paths are resolved against the file's folder. Errors are one line with file, line, key, value and remedy:
// NotFound for a file that is missing, InvalidArgument for all else. Every key has the default that stands
// above.
absl::StatusOr<DaemonConfig> read_config(const std::filesystem::path& file);
absl::StatusOr<DaemonConfig> parse_config_toml(const std::string& text, const std::filesystem::path& folder,
                                               const std::string& name_for_errors, bool check_files_exist);

// Empty if `text` is HOST:PORT ([HOST]:PORT with IPv6), else what is wrong with it. For the command line too.
std::string listen_address_problem(std::string_view text);

}  // namespace kinevox
