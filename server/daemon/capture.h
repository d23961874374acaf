// The capture of the daemon: source, pipeline, and everything that observes or changes them.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <memory>
#include <optional>

#include "server/api/subscribers.h"
#include "server/calibration/procedure/active_calibration.h"
#include "server/calibration/procedure/calibration_store.h"
#include "server/calibration/procedure/camera_watch.h"
#include "server/calibration/procedure/procedure.h"
#include "server/config/daemon_config.h"
#include "server/daemon/kinevoxd.h"
#include "server/daemon/replayed_names.h"
#include "server/daemon/stored_background.h"
#include "server/metrics/capture_metrics.h"
#include "server/pipeline/capture_statistics.h"
#include "server/pipeline/gpu.h"
#include "server/pipeline/pipeline.h"
#include "server/pipeline/replay.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"
#include "server/pose/database/database_service.h"
#include "server/pose/live_body_fit.h"
#include "server/quality/faint_switch.h"
#include "server/quality/live_quality.h"
#include "server/recording/recorder.h"

namespace kinevox {

// Members in the order in which they start; the services read them, the shutdown is below. Nothing runs by
// itself until start_background_work() or Runner::start().
struct Capture {
    explicit Capture(const DaemonConfig& config);
    static absl::StatusOr<std::unique_ptr<Capture>> create(const DaemonConfig& config,
                                                           const MakeGpu& make_gpu);

    const DaemonConfig config;
    StoredBackground background;
    PipelineOptions options;
    std::shared_ptr<Gpu> gpu;  // null if none is configured
    StreamHub hub;
    DatabaseWatch pose_watch;
    std::optional<PoseDatabaseService> poses;  // empty without a pose database
    std::unique_ptr<Runner> runner;
    Pipeline* live_pipeline = nullptr;  // of the cameras, also during a replay
    PoseStage* pose_stage = nullptr;    // its first; null if no poses are measured
    BodyWatch body_watch;
    std::unique_ptr<LiveBodyFit> body_fit;  // null if no poses are measured
    CaptureStatistics statistics;
    quality::LiveQuality quality;
    std::optional<quality::FaintSwitch> faint;  // empty: the segmentation does not change
    std::unique_ptr<CameraWatch> camera_watch;
    std::unique_ptr<CalibrationStore> calibrations;
    std::unique_ptr<ActiveCalibration> active_calibration;
    std::unique_ptr<Recorder> recorder;
    ReplayedNames replayed_names;
    std::unique_ptr<Replay> replay;
    ProcedureWatch procedure_watch;
    std::unique_ptr<CalibrationProcedure> procedure;

    // On the control thread: builds or reads the pose database, now and whenever a calibration is applied.
    void start_background_work();

    // Shutdown in this order. Everything that blocks is notified first, so that nothing waits long.
    void notify_shutdown(const absl::Status& why);
    void stop();   // the runner's threads, after the last call that may start them
    void close();  // the recorder and the worker threads, after the last encoder

    metrics::MetricsSnapshot metrics_snapshot() const;

  private:
    absl::Status open(const MakeGpu& make_gpu);
    absl::StatusOr<std::unique_ptr<FrameSource>> open_frame_source();
    void observe(const FrameResult& result);
    const BodyShape* body_of(std::uint32_t subject_id) const;
    void fit_bodies(const FrameResult& result);
    void choose_segmentation(const FrameResult& result);
    void restore_calibration();
    void build_pose_database(const std::vector<Camera>& cameras);

    bool background_work_started_ = false;  // the control thread's
    const std::chrono::system_clock::time_point started_at_ = std::chrono::system_clock::now();
};

}  // namespace kinevox
