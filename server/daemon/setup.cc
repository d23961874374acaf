#include "server/daemon/setup.h"

#include <fmt/format.h>
#include <grpc/support/log.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <thread>

#include "common/files.h"
#include "common/session_file.h"
#include "common/utc_clock.h"
#include "server/cameras/aravis/live_source.h"
#include "server/cameras/session_source.h"
#include "server/cameras/studio/studio_source.h"
#include "server/daemon/journal_sink.h"
#include "server/pipeline/convert.h"

namespace kinevox {
namespace {

// A message takes gRPC, the kernel and a subscriber on the same machine 35 to 45 us of a processor of the
// 2020s (tests/bench/many_watchers.py); the rest is for the capture.
constexpr double kLatestMessagesPerCore = 16000;

std::chrono::milliseconds milliseconds(double seconds) {
    return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000));
}

}  // namespace

absl::Status set_up_logging(const LogConfig& config) {
    std::vector<spdlog::sink_ptr> sinks;
    if (stderr_is_journal())
        sinks.push_back(std::make_shared<JournalSink>());
    else
        sinks.push_back(std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
    if (!config.file.empty()) {
        try {
            sinks.push_back(std::make_shared<spdlog::sinks::basic_file_sink_mt>(config.file.string()));
        } catch (const spdlog::spdlog_ex& error) {
            return absl::UnavailableError(
                fmt::format("{}: the log cannot be written ({}); correct [log] file", config.file.string(),
                            error.what()));
        }
    }
    auto logger = std::make_shared<spdlog::logger>("kinevoxd", sinks.begin(), sinks.end());
    logger->set_level(spdlog::level::from_str(config.level));
    logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%L%$ %v");
    logger->flush_on(spdlog::level::info);
    spdlog::set_default_logger(std::move(logger));
    gpr_set_log_function([](gpr_log_func_args* args) { spdlog::debug("gRPC: {}", args->message); });
    return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<FrameSource>> open_source(const SourceConfig& config) {
    const Pacing pacing =
        config.pacing == SourceConfig::Pacing::kRealTime ? Pacing::kRealTime : Pacing::kAsFastAsPossible;
    switch (config.kind) {
        case SourceConfig::Kind::kSession:
            return open_session_source(config.session_file, {.pacing = pacing, .loop = config.loop});
        case SourceConfig::Kind::kCameras:
            return open_live_source(config.cameras);
        case SourceConfig::Kind::kStudio: {
            StudioSourceOptions options;
            options.studio.motion = config.studio.motion;
            options.studio.cameras = config.studio.camera_count;
            options.studio.width = config.studio.width_px;
            options.studio.height = config.studio.height_px;
            options.studio.fps = config.studio.fps;
            options.studio.seed = config.studio.seed;
            options.studio.stature_m = config.studio.stature_m;
            options.pacing = pacing;
            return StudioSource::create(options);
        }
    }
    return absl::InternalError("unknown source kind");
}

std::string describe(const SourceConfig& config) {
    switch (config.kind) {
        case SourceConfig::Kind::kSession:
            return "session " + config.session_file.string();
        case SourceConfig::Kind::kCameras: {
            std::string names;
            for (const LiveCameraConfig& camera : config.cameras.cameras)
                names += (names.empty() ? "" : ", ") + camera.name;
            return "cameras " + names;
        }
        case SourceConfig::Kind::kStudio:
            break;
    }
    return "studio " + config.studio.motion;
}

ControlLeaseOptions lease_options(const ControlConfig& config) {
    return {milliseconds(config.default_lease_s), milliseconds(config.max_lease_s)};
}

ApiStreams stream_settings(const StreamConfig& config, FairShare& fair_share) {
    return {.fair_share = &fair_share,
            .lossless_max_messages = static_cast<std::size_t>(config.max_lossless_messages),
            .lossless_max_bytes = static_cast<std::size_t>(config.max_lossless_mb) << 20,
            .preview_width_px = config.default_preview_width_px,
            .preview_jpeg_quality = config.default_preview_jpeg_quality};
}

double max_latest_messages_per_s(const StreamConfig& config) {
    if (config.max_latest_messages_per_s > 0) return config.max_latest_messages_per_s;
    return kLatestMessagesPerCore * std::max(std::thread::hardware_concurrency(), 1u);
}

std::filesystem::path pose_database_file(const PoseConfig& config) {
    if (!config.enabled) return {};
    return config.database_file ? *config.database_file : in_state_folder("poses.kvxposes");
}

std::filesystem::path fitted_body_file(const PoseConfig& config) {
    return config.fitted_body_file ? *config.fitted_body_file : in_state_folder("body.toml");
}

DaemonConfig with_fitted_body(DaemonConfig config) {
    const std::filesystem::path file = fitted_body_file(config.pose);
    std::error_code error;
    if (!config.pose.enabled || config.tracking.several_subjects()) return config;  // it is of one person
    if (!config.pose.body_file.empty() || file.empty() || !std::filesystem::exists(file, error))
        return config;
    if (const auto body = read_body_shape(file); body.ok()) {
        spdlog::info("using the fitted body of {:.2f} m from {}; `kinevox body fit` fits another",
                     body->stature_m, file.string());
        config.pose.body_file = file;
    } else {
        spdlog::warn("not using the body that was fitted before: {}", std::string(body.status().message()));
    }
    return config;
}

std::filesystem::path background_folder(const DaemonConfig& config) {
    if (config.source.kind != SourceConfig::Kind::kCameras) return {};
    return config.segmentation.background_folder ? *config.segmentation.background_folder
                                                 : in_state_folder("background");
}

std::filesystem::path calibration_folder(const CalibrationConfig& config) {
    return config.folder ? *config.folder : in_state_folder("calibrations");
}

std::filesystem::path recordings_folder(const RecordingConfig& config) {
    return config.folder ? *config.folder : in_state_folder("recordings");
}

std::string unwritable_reason(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::path existing = folder;
    while (!existing.empty() && !std::filesystem::exists(existing, error) &&
           existing != existing.parent_path())
        existing = existing.parent_path();
    if (!std::filesystem::is_directory(existing, error)) return existing.string() + " is no folder";
    if (::access(existing.c_str(), W_OK | X_OK) != 0)
        return fmt::format("{}: {}", existing.string(), std::generic_category().message(errno));
    return {};
}

void warn_of_unwritable_recordings(const std::filesystem::path& folder) {
    if (folder.empty()) return;
    if (const std::string reason = unwritable_reason(folder); !reason.empty())
        spdlog::warn("recordings cannot be written to {} ({}); correct [recording] folder or its permissions",
                     folder.string(), reason);
}

absl::StatusOr<std::unique_ptr<Recorder>> make_recorder(const DaemonConfig& daemon, const Runner& runner,
                                                        const CalibrationStore& store,
                                                        const ActiveCalibration& active, EventLog& events) {
    const auto bytes = [](int megabytes) { return static_cast<std::size_t>(megabytes) << 20; };
    const RecordingConfig& config = daemon.recording;
    std::filesystem::path own_calibration;
    if (daemon.source.kind == SourceConfig::Kind::kSession)
        if (const auto session = read_session(daemon.source.session_file); session.ok())
            own_calibration = session->calibration;
    RecorderOptions options;
    options.folder = recordings_folder(config);
    for (const VideoCodec codec : {VideoCodec::kFfv1, VideoCodec::kUtVideo, VideoCodec::kH264})
        if (name_of(codec) == config.codec) options.codec = codec;
    options.save_poses = config.save_poses;
    options.save_volumes = config.save_volumes;
    options.several_subjects = daemon.tracking.several_subjects();
    options.max_buffer_s = options.folder.empty() ? 0 : config.max_buffer_s;
    options.max_buffer_bytes = bytes(config.max_buffer_mb);
    options.max_queue_bytes = bytes(config.max_queue_mb);
    options.min_free_bytes = bytes(config.min_free_disk_mb);
    return Recorder::create(
        options,
        [&runner, &store, &active, own_calibration] {
            RecordedCapture capture{
                runner.cameras(), runner.source_fps(), active.active(), {}, own_calibration};
            if (!capture.calibration_id.empty())
                capture.calibration_file = store.calibration_file(capture.calibration_id);
            if (!capture.calibration_id.empty())
                if (auto certificate = store.certificate_json(capture.calibration_id); certificate.ok())
                    capture.certificate_json = *std::move(certificate);
            return capture;
        },
        [&events](const Event& event) { events.publish(event); });
}

RetentionLimits retention_limits(const RecordingConfig& config) {
    return {config.retention_days, static_cast<std::uint64_t>(config.max_total_gb * 1e9)};
}

PoseDatabaseOptions pose_database_options(const PoseConfig& config) {
    PoseDatabaseOptions options;
    options.poses = config.library_pose_count;
    // Half of the cores: the others are for the capture.
    options.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency() / 2, 1u, 64u));
    return options;
}

void start_pose_database(PoseDatabaseService& database, const PoseConfig& config,
                         const std::vector<Camera>& cameras, const BodyShape& body, EventLog& events,
                         DatabaseWatch& watch) {
    std::vector<kernels::CameraModel> models;
    for (const Camera& camera : cameras) models.push_back(to_kernel(camera));
    database.start(
        std::move(models), body, pose_database_options(config), [&](const DatabaseProgress& progress) {
            watch.publish(progress);
            const std::string why = progress.message.empty() ? "read from its file" : progress.message;
            if (progress.state == PoseDatabaseState::kReady)
                events.publish(
                    EventKind::kPoseDatabaseReady,
                    fmt::format("the pose database is ready: {} entries; {}", progress.entry_count, why));
            else if (progress.state == PoseDatabaseState::kFailed)
                events.publish(EventKind::kError, "there is no pose database: " + why);
        });
}

std::unique_ptr<LiveBodyFit> make_body_fit(const PoseConfig& config, const Runner& runner,
                                           const PipelineOptions& pipeline, PoseDatabaseService* database,
                                           EventLog& events, BodyWatch& watch) {
    LiveBodyFitOptions options;
    options.automatic = config.auto_fit_body && config.body_file.empty();
    options.several_subjects = pipeline.tracker.several_subjects();
    if (!options.several_subjects) options.file = fitted_body_file(config);
    const auto on_end = [database, &events, several = options.several_subjects](const BodyFitProgress& fit) {
        // The database is searched for all subjects; several have no common stature.
        if (database && fit.state == BodyFitState::kReady && !several)
            database->set_stature(fit.body.stature_m);
        Event event;
        event.kind = fit.state == BodyFitState::kReady ? EventKind::kBodyFitted : EventKind::kError;
        event.subject_id = fit.subject_id;
        event.message = (several && fit.subject_id ? fmt::format("subject {}: ", fit.subject_id) : "") +
                        (fit.state == BodyFitState::kReady ? "" : "no body was fitted: ") + fit.message;
        events.publish(std::move(event));
    };
    auto fit = std::make_unique<LiveBodyFit>(
        runner.cameras(), runner.source_fps(), pipeline.posing, options,
        LiveBodyFit::Observers{[&watch](const std::vector<BodyFitProgress>& all) { watch.publish(all); },
                               on_end});
    watch.publish(fit->progress());
    return fit;
}

std::unique_ptr<CalibrationProcedure> make_calibration_procedure(CalibrationStore& store, StreamHub& hub,
                                                                 ProcedureWatch& watch) {
    return std::make_unique<CalibrationProcedure>(
        [&hub](std::function<void()> on_ready) { return hub.subscribe_images(std::move(on_ready)); },
        [&store, &hub](const Certificate& certificate, const std::string& note) {
            auto id = store.add(certificate.cameras, certificate_json(certificate), certificate.method,
                                certificate.verdict(), note, utc_now_ns());
            if (id.ok())
                hub.events().publish(
                    EventKind::kCalibrationChanged,
                    fmt::format("calibration {} is solved: {}", *id, to_text(certificate.verdict())));
            return id;
        },
        [&watch] { return watch.watched(); },
        [&watch](const ProcedureProgress& progress) { watch.publish(progress); });
}

Replay::MakePipeline make_replay_pipeline(const PipelineOptions& options, const Runner& runner,
                                          PoseDatabaseService* database) {
    return [options, live = runner.cameras(), database](
               const std::vector<Camera>& cameras, double fps) -> absl::StatusOr<std::unique_ptr<Pipeline>> {
        PipelineOptions of_replay = options;
        of_replay.allow_discontinuities = true;
        auto pipeline = Pipeline::create(cameras, fps, of_replay);
        if (pipeline.ok() && database && (*pipeline)->pose_stage() && cameras == live)
            (*pipeline)->pose_stage()->set_proposer(database);
        return pipeline;
    };
}

}  // namespace kinevox
