// What monitoring reads of the daemon. docs/monitoring.md lists the metrics.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/cameras/camera_connection.h"
#include "server/metrics/metrics_text.h"
#include "server/pipeline/gpu.h"
#include "server/pipeline/run_statistics.h"
#include "server/pipeline/runner.h"

namespace kinevox::metrics {

struct StreamMetrics {
    std::string name;
    int subscribers = 0;
    // Absent for streams whose messages are not counted.
    std::optional<Histogram> latency_s;
    std::uint64_t sent = 0, missed = 0;
};

struct CameraMetrics {
    std::string name;
    std::optional<CameraConnection> connection;  // of a live camera
    std::optional<double> silhouette_iou;        // while a subject is tracked
    std::optional<double> scene_shift_px;
    std::optional<bool> calibration_suspect;  // absent during a replay
};

struct RecorderMetrics {
    bool active = false;
    std::uint64_t free_bytes = 0, queued_bytes = 0;
    double buffered_s = 0;
};

// The values of all metrics at one time.
struct MetricsSnapshot {
    std::string version, source;
    double start_time_s = 0;  // of the daemon, since 1970
    RunState state = RunState::kStopped;
    double nominal_fps = 0;
    RunSnapshot run;
    int subjects_tracked = 0, subjects_with_pose = 0;
    std::vector<std::pair<std::uint32_t, double>> subject_volumes_litres;  // by subject id
    std::vector<std::pair<std::string, Histogram>> stages_s;
    std::vector<StreamMetrics> streams;
    std::vector<CameraMetrics> cameras;
    std::optional<RecorderMetrics> recorder;  // absent without a recording folder
    bool gpu_configured = false;
    Gpu::State gpu{.usable = false};
};

// Those of the snapshot and of the process. Any thread.
std::string capture_metrics(const MetricsSnapshot& snapshot, Format format);

}  // namespace kinevox::metrics
