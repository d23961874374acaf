// Makes the daemon's parts by its configuration.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <memory>
#include <string>

#include "server/api/api_context.h"
#include "server/cameras/frame_source.h"
#include "server/config/daemon_config.h"
#include "server/events/event_log.h"
#include "server/pipeline/pipeline.h"
#include "server/pipeline/replay.h"
#include "server/pose/database/database_service.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_list.h"

namespace kinevox {

// spdlog's default logger: standard error, and the file if one is configured, with gRPC's own messages at
// debug level. Unavailable if the file cannot be written.
absl::Status set_up_logging(const LogConfig& config);

absl::StatusOr<std::unique_ptr<FrameSource>> open_source(const SourceConfig& config);
std::string describe(
    const SourceConfig& config);  // "studio walk", "session /data/trial/session.toml", "cameras left, right"

ControlLeaseOptions lease_options(const ControlConfig& config);
ApiStreams stream_settings(const StreamConfig& config, FairShare& fair_share);
double max_latest_messages_per_s(const StreamConfig& config);

// The file of the pose database; empty: none, by the configuration or because the user has no state folder.
std::filesystem::path pose_database_file(const PoseConfig& config);
// Stores a fitted body; empty: off.
std::filesystem::path fitted_body_file(const PoseConfig& config);

// Adds the body that was fitted and stored before, unless the configuration has one.
DaemonConfig with_fitted_body(DaemonConfig config);

// Stores the background of live cameras; empty: off, as for other sources, which have their own.
std::filesystem::path background_folder(const DaemonConfig& config);

// Stores calibrations; empty: off.
std::filesystem::path calibration_folder(const CalibrationConfig& config);

// Stores recordings; empty: off.
std::filesystem::path recordings_folder(const RecordingConfig& config);
// Empty if the folder, or the nearest existing folder above it, can be written, else why not. Creates
// nothing.
std::string unwritable_reason(const std::filesystem::path& folder);
// A warning in the log where no recording can start.
void warn_of_unwritable_recordings(const std::filesystem::path& folder);

// The arguments must outlive the recorder.
absl::StatusOr<std::unique_ptr<Recorder>> make_recorder(const DaemonConfig& config, const Runner& runner,
                                                        const CalibrationStore& store,
                                                        const ActiveCalibration& active, EventLog& events);

RetentionLimits retention_limits(const RecordingConfig& config);

PoseDatabaseOptions pose_database_options(const PoseConfig& config);

// Reads or builds it in the background; an event reports the result. Events and watch must outlive the
// database. Called again with the new cameras when a calibration is applied: a build in progress is
// cancelled, the previous database answers meanwhile, and user poses are kept.
void start_pose_database(PoseDatabaseService& database, const PoseConfig& config,
                         const std::vector<Camera>& cameras, const BodyShape& body, EventLog& events,
                         DatabaseWatch& watch);

// Fits the subject's body in the background and notifies the watch, the events and the database, if there is
// one. All of them must outlive it. `cameras` in the order of the runner's.
std::unique_ptr<LiveBodyFit> make_body_fit(const PoseConfig& config, const Runner& runner,
                                           const PipelineOptions& pipeline, PoseDatabaseService* database,
                                           EventLog& events, BodyWatch& watch);

// The procedure: processes the hub's latest results, stores what it solves, notifies the watch and the
// events. All of them must outlive it.
std::unique_ptr<CalibrationProcedure> make_calibration_procedure(CalibrationStore& store, StreamHub& hub,
                                                                 ProcedureWatch& watch);

// Pipelines for replays, by `options`. The pose database proposes poses to those whose cameras are the
// runner's.
Replay::MakePipeline make_replay_pipeline(const PipelineOptions& options, const Runner& runner,
                                          PoseDatabaseService* database);

}  // namespace kinevox
