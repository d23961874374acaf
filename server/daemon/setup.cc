#include "server/daemon/setup.h"

#include <fmt/format.h>
#include <grpc/support/log.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>

#include "common/state_folder.h"
#include "server/cameras/aravis/live_source.h"
#include "server/cameras/session_source.h"
#include "server/cameras/studio/studio_source.h"
#include "server/daemon/journal_sink.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

// A message to a subscriber costs gRPC, the kernel and a reader on the same machine 35 to 45 us of a 2020s
// processor (tests/bench/many_watchers.py); the capture needs some, too.
constexpr double kNewestPerCore = 16000;

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
            return open_session_source(config.session, {.pacing = pacing, .loop = config.loop});
        case SourceConfig::Kind::kCameras:
            return open_live_source(config.cameras);
        case SourceConfig::Kind::kStudio: {
            StudioSourceOptions options;
            options.studio.motion = config.studio.motion;
            options.studio.cameras = config.studio.cameras;
            options.studio.width = config.studio.width;
            options.studio.height = config.studio.height;
            options.studio.fps = config.studio.fps;
            options.studio.seed = config.studio.seed;
            options.studio.subject_height_m = config.studio.subject_height_m;
            options.pacing = pacing;
            return StudioSource::create(options);
        }
    }
    return absl::InternalError("a source of a kind that nobody wrote");
}

std::string describe(const SourceConfig& config) {
    switch (config.kind) {
        case SourceConfig::Kind::kSession:
            return "session " + config.session.string();
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

absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config) {
    PipelineOptions options;
    options.device = config.pipeline.device == PipelineConfig::Device::kCuda ? kernels::Device::kCuda
                                                                             : kernels::Device::kCpu;
    options.voxel_m = config.pipeline.voxel_mm / 1000;
    options.colouring = config.pipeline.colouring;
    options.pose = config.pose.enabled;
    options.posing.filtered = config.pose.filtered;
    if (!config.pose.body.empty()) {
        absl::StatusOr<BodyShape> body = read_body_shape(config.pose.body);
        if (!body.ok()) return body.status();
        options.posing.body = *std::move(body);
    }
    options.segmentation.samples = config.segmentation.samples;
    options.segmentation.sharp_threshold = static_cast<float>(config.segmentation.sharp_threshold);
    options.segmentation.loose_threshold = static_cast<float>(config.segmentation.loose_threshold);
    return options;
}

ControlLeaseOptions lease_options(const ControlConfig& config) {
    return {milliseconds(config.lease_timeout_s), milliseconds(config.max_lease_timeout_s)};
}

void apply(const StreamConfig& config, ApiContext& api) {
    api.lossless_max_messages = static_cast<std::size_t>(config.lossless_max_messages);
    api.lossless_max_bytes = static_cast<std::size_t>(config.lossless_max_mb) << 20;
    api.preview_width_px = config.preview_width_px;
    api.preview_jpeg_quality = config.preview_jpeg_quality;
}

double newest_per_s(const StreamConfig& config) {
    if (config.newest_per_s > 0) return config.newest_per_s;
    return kNewestPerCore * std::max(std::thread::hardware_concurrency(), 1u);
}

std::filesystem::path pose_database_file(const PoseConfig& config) {
    if (!config.enabled) return {};
    return config.database ? *config.database : in_state_folder("poses.kvxposes");
}

std::filesystem::path fitted_body_file(const PoseConfig& config) {
    return config.fitted_body ? *config.fitted_body : in_state_folder("body.toml");
}

DaemonConfig with_fitted_body(DaemonConfig config) {
    const std::filesystem::path file = fitted_body_file(config.pose);
    std::error_code error;
    if (!config.pose.enabled || !config.pose.body.empty() || file.empty() ||
        !std::filesystem::exists(file, error))
        return config;
    if (const auto body = read_body_shape(file); body.ok()) {
        spdlog::info(
            "the body that was fitted before is used, of {:.2f} m, from {}; `kinevox body fit` measures "
            "another",
            body->stature_m, file.string());
        config.pose.body = file;
    } else {
        spdlog::warn("the body that was fitted before is not used: {}", std::string(body.status().message()));
    }
    return config;
}

std::filesystem::path background_folder(const DaemonConfig& config) {
    if (config.source.kind != SourceConfig::Kind::kCameras) return {};
    return config.segmentation.stored_background ? *config.segmentation.stored_background
                                                 : in_state_folder("background");
}

std::filesystem::path calibration_folder(const CalibrationConfig& config) {
    return config.folder ? *config.folder : in_state_folder("calibrations");
}

std::filesystem::path recordings_folder(const RecordingConfig& config) {
    return config.folder ? *config.folder : in_state_folder("recordings");
}

absl::StatusOr<std::unique_ptr<Recorder>> make_recorder(const DaemonConfig& daemon, const Runner& runner,
                                                        const CalibrationStore& store,
                                                        const CalibrationUse& use, StreamHub& hub) {
    const auto bytes = [](int megabytes) { return static_cast<std::size_t>(megabytes) << 20; };
    const RecordingConfig& config = daemon.recording;
    std::filesystem::path own_calibration;
    if (daemon.source.kind == SourceConfig::Kind::kSession)
        if (const auto session = read_session(daemon.source.session); session.ok())
            own_calibration = session->calibration;
    RecorderOptions options;
    options.folder = recordings_folder(config);
    for (const VideoCodec codec : {VideoCodec::kFfv1, VideoCodec::kUtVideo, VideoCodec::kH264})
        if (name_of(codec) == config.codec) options.codec = codec;
    options.poses = config.poses;
    options.volumes = config.volumes;
    options.keep_last_s = options.folder.empty() ? 0 : config.keep_last_s;
    options.keep_last_bytes = bytes(config.keep_last_mb);
    options.queue_bytes = bytes(config.queue_mb);
    options.min_free_bytes = bytes(config.min_free_mb);
    return Recorder::create(
        options,
        [&runner, &store, &use, own_calibration] {
            RecordedCapture capture{runner.cameras(), runner.source_fps(), use.in_use(), {}, own_calibration};
            if (!capture.calibration_id.empty())
                capture.calibration_file = store.calibration_file(capture.calibration_id);
            if (!capture.calibration_id.empty())
                if (auto certificate = store.certificate_json(capture.calibration_id); certificate.ok())
                    capture.certificate_json = *std::move(certificate);
            return capture;
        },
        [&hub](const Event& event) { hub.publish_event(event, utc_now_ns()); });
}

RetentionLimits retention_limits(const RecordingConfig& config) {
    return {config.keep_days, static_cast<std::uint64_t>(config.keep_gb * 1e9)};
}

PoseDatabaseOptions pose_database_options(const PoseConfig& config) {
    PoseDatabaseOptions options;
    options.poses = config.database_poses;
    // Half of the cores: the capture's own threads run beside it.
    options.threads = static_cast<int>(std::clamp(std::thread::hardware_concurrency() / 2, 1u, 64u));
    return options;
}

void start_pose_database(PoseDatabaseService& database, const PoseConfig& config,
                         const std::vector<Camera>& cameras, const BodyShape& body, StreamHub& hub,
                         DatabaseWatch& watch) {
    std::vector<kernels::CameraModel> models;
    for (const Camera& camera : cameras) models.push_back(to_kernel(camera));
    database.start(
        std::move(models), body, pose_database_options(config), [&](const DatabaseProgress& progress) {
            watch.publish(progress);
            const std::string why = progress.message.empty() ? "read as it was stored" : progress.message;
            if (progress.state == DatabaseState::kReady)
                hub.publish_event(
                    {EventKind::kPoseDatabase,
                     0,
                     0,
                     {},
                     fmt::format("the pose database is ready: {} entries; {}", progress.entries, why)},
                    utc_now_ns());
            else if (progress.state == DatabaseState::kFailed)
                hub.publish_event({EventKind::kError, 0, 0, {}, "there is no pose database: " + why},
                                  utc_now_ns());
        });
}

std::unique_ptr<LiveBodyFit> make_body_fit(const PoseConfig& config, const Runner& runner,
                                           const PoseStageOptions& posing, PoseDatabaseService* database,
                                           StreamHub& hub, BodyWatch& watch) {
    LiveBodyFitOptions options;
    options.by_itself = config.fit_body && config.body.empty();
    options.file = fitted_body_file(config);
    auto fit = std::make_unique<LiveBodyFit>(
        runner.cameras(), runner.source_fps(), posing, options,
        [database, &hub, &watch](const BodyFitProgress& progress) {
            watch.publish(progress);
            if (progress.state == BodyFitState::kReady) {
                if (database) database->set_stature(progress.body.stature_m);
                hub.publish_event({EventKind::kBodyFitted, 0, 0, {}, progress.message}, utc_now_ns());
            } else if (progress.state == BodyFitState::kFailed) {
                hub.publish_event({EventKind::kError, 0, 0, {}, "no body was fitted: " + progress.message},
                                  utc_now_ns());
            }
        });
    watch.publish(fit->progress());
    return fit;
}

std::unique_ptr<CalibrationProcedure> make_calibration_procedure(CalibrationStore& store, StreamHub& hub,
                                                                 ProcedureWatch& watch) {
    return std::make_unique<CalibrationProcedure>(
        [&hub](std::function<void()> on_ready) { return hub.subscribe_pictures(std::move(on_ready)); },
        [&store, &hub](const Certificate& certificate, const std::string& note) {
            auto id = store.add(certificate.cameras, certificate_json(certificate), certificate.made_by,
                                certificate.verdict(), note, utc_now_ns());
            if (id.ok())
                hub.publish_event(
                    {EventKind::kCalibration,
                     0,
                     0,
                     {},
                     fmt::format("calibration {} is solved: {}", *id, to_text(certificate.verdict()))},
                    utc_now_ns());
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
        of_replay.jumps = true;
        auto pipeline = Pipeline::create(cameras, fps, of_replay);
        if (pipeline.ok() && database && (*pipeline)->pose_stage() && cameras == live)
            (*pipeline)->pose_stage()->set_proposer(database);
        return pipeline;
    };
}

}  // namespace kinevox
