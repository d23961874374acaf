// From the configuration to the daemon's parts.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <memory>
#include <string>

#include "common/config.h"
#include "server/api/api_context.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/pipeline.h"
#include "server/pipeline/replay.h"
#include "server/pose/database/database_service.h"
#include "server/recording/recorder.h"
#include "server/recording/retention.h"

namespace kinevox {

// spdlog's default logger: standard error, and the file where one is configured. gRPC's own messages go to
// it, too, at debug. Unavailable where the file cannot be written.
absl::Status set_up_logging(const LogConfig& config);

absl::StatusOr<std::unique_ptr<FrameSource>> open_source(const SourceConfig& config);
std::string describe(
    const SourceConfig& config);  // "studio walk", "session /data/trial/session.toml", "cameras left, right"

absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config);
ControlLeaseOptions lease_options(const ControlConfig& config);
void apply(const StreamConfig& config, ApiContext& api);
double newest_per_s(const StreamConfig& config);

// Where the pose database lies and whether there is one: empty where the configuration says so, or where it
// says nothing and the user has no home.
std::filesystem::path pose_database_file(const PoseConfig& config);
// Where a fitted body is stored; empty: nowhere.
std::filesystem::path fitted_body_file(const PoseConfig& config);

// The same, with the body that was fitted and stored before where the configuration names none.
DaemonConfig with_fitted_body(DaemonConfig config);

// Where the background of live cameras is stored; empty: nowhere, as for other sources, which have their own.
std::filesystem::path background_folder(const DaemonConfig& config);

// Where calibrations are stored; empty: nowhere.
std::filesystem::path calibration_folder(const CalibrationConfig& config);

// Where recordings are stored; empty: nowhere.
std::filesystem::path recordings_folder(const RecordingConfig& config);
// What records the capture. All of them must outlive it.
absl::StatusOr<std::unique_ptr<Recorder>> make_recorder(const DaemonConfig& config, const Runner& runner,
                                                        const CalibrationStore& store,
                                                        const CalibrationUse& use, StreamHub& hub);

RetentionLimits retention_limits(const RecordingConfig& config);

PoseDatabaseOptions pose_database_options(const PoseConfig& config);

// Reads or builds it in the background; when that is over an event says what came of it. Hub and watch must
// outlive the database. To be called again with the new cameras when a calibration is applied: a build under
// way gives way, the database of before answers meanwhile, and what users added is kept.
void start_pose_database(PoseDatabaseService& database, const PoseConfig& config,
                         const std::vector<Camera>& cameras, const BodyShape& body, StreamHub& hub,
                         DatabaseWatch& watch);

// Fits the subject's body behind the capture: tells the watchers, the hub's events and the database, if there
// is one. All of them must outlive it. `cameras` in the order of the runner's.
std::unique_ptr<LiveBodyFit> make_body_fit(const PoseConfig& config, const Runner& runner,
                                           const PoseStageOptions& posing, PoseDatabaseService* database,
                                           StreamHub& hub, BodyWatch& watch);

// The procedure: looks at the hub's newest results, stores what it solves, tells the watchers and the hub's
// events. All of them must outlive it.
std::unique_ptr<CalibrationProcedure> make_calibration_procedure(CalibrationStore& store, StreamHub& hub,
                                                                 ProcedureWatch& watch);

// Pipelines for recordings, as `options` say. The pose database proposes poses to those whose cameras are the
// runner's.
Replay::MakePipeline make_replay_pipeline(const PipelineOptions& options, const Runner& runner,
                                          PoseDatabaseService* database);

}  // namespace kinevox
