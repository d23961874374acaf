#include "server/daemon/capture.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "server/daemon/setup.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

namespace {

// Of the subject that the camera's silhouette fits least.
std::optional<double> min_silhouette_iou(const FrameResult& result, std::size_t camera) {
    std::optional<double> min;
    for (const SubjectResult& subject : result.subjects) {
        if (camera >= subject.silhouette_iou.size() || std::isnan(subject.silhouette_iou[camera])) continue;
        const auto iou = static_cast<double>(subject.silhouette_iou[camera]);
        min = std::min(min.value_or(iou), iou);
    }
    return min;
}

}  // namespace

Capture::Capture(const DaemonConfig& given)
    : config(given),
      background(background_folder(config), [](const std::string& message) { spdlog::info("{}", message); }),
      quality({.several_subjects = config.tracking.several_subjects(),
               .subjects_selected = config.tracking.rules != SubjectRules{}}) {
    quality.set_judge_faint(config.segmentation.options.judge_faint);
}

absl::StatusOr<std::unique_ptr<Capture>> Capture::create(const DaemonConfig& config,
                                                         const MakeGpu& make_gpu) {
    auto capture = std::make_unique<Capture>(config);
    if (absl::Status opened = capture->open(make_gpu); !opened.ok()) return opened;
    return capture;
}

absl::StatusOr<std::unique_ptr<FrameSource>> Capture::open_frame_source() {
    auto source = open_source(config.source);
    if (!source.ok()) return source;
    return background.restoring(*std::move(source));
}

absl::Status Capture::open(const MakeGpu& make_gpu) {
    auto source = open_frame_source();
    if (!source.ok()) return source.status();
    auto read_options = pipeline_options(config);
    if (!read_options.ok()) return read_options.status();
    options = *std::move(read_options);
    if (options.device.is_cuda()) {
        gpu = std::make_shared<Gpu>(make_gpu(options.device));
        if (gpu->usable()) spdlog::info("computing on {} ({})", gpu->device(), gpu->name());
    }
    options.gpu = gpu;
    auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), options);
    if (!pipeline.ok()) return pipeline.status();

    live_pipeline = pipeline->get();
    pose_stage = live_pipeline->pose_stage();
    if (const auto file = pose_database_file(config.pose); !file.empty()) {
        poses.emplace(file);
        pose_stage->set_proposer(&*poses);  // has nothing to propose until it is built
    }
    runner = std::make_unique<Runner>(
        std::move(*source), [this] { return open_frame_source(); }, std::move(*pipeline), hub);
    if (pose_stage && config.segmentation.auto_judge_faint && !options.segmentation.judge_faint)
        faint.emplace();
    if (pose_stage)
        body_fit =
            make_body_fit(config.pose, *runner, options, poses ? &*poses : nullptr, hub.events(), body_watch);
    camera_watch = std::make_unique<CameraWatch>(runner->cameras(), CameraWatchOptions{},
                                                 [this](const Event& event) { hub.events().publish(event); });
    restore_calibration();
    auto made_recorder = make_recorder(config, *runner, *calibrations, *active_calibration, hub.events());
    if (!made_recorder.ok()) return made_recorder.status();
    recorder = *std::move(made_recorder);
    warn_of_unwritable_recordings(recorder->options().folder);

    runner->set_result_observer([this](const FrameResult& result) { observe(result); });
    runner->set_observers({[this](const FrameSet& frame_set) { recorder->offer(frame_set); },
                           [this](const BackgroundImages& images) {
                               background.store(runner->cameras(), runner->source_fps(), images);
                               recorder->background_learned(images);
                               quality.set_background(runner->cameras(), images);
                           },
                           [this] {
                               recorder->capture_ended();
                               if (body_fit) body_fit->capture_ended();
                           }});
    replay = std::make_unique<Replay>(
        *runner,
        [this, make = make_replay_pipeline(options, *runner, poses ? &*poses : nullptr)](
            const std::vector<Camera>& cameras, double fps) {
            replayed_names.close();  // before the first result of another recording
            return make(cameras, fps);
        },
        [this](EventKind kind, std::string message) {
            if (kind == EventKind::kReplayOpened) replayed_names.open(replay->status().session_file);
            hub.events().publish(kind, std::move(message));
        });
    procedure = make_calibration_procedure(*calibrations, hub, procedure_watch);
    return absl::OkStatus();
}

// The calibration that was applied last, instead of the source's own.
void Capture::restore_calibration() {
    calibrations = std::make_unique<CalibrationStore>(calibration_folder(config.calibration),
                                                      describe(config.source), runner->cameras());
    active_calibration = std::make_unique<ActiveCalibration>(*calibrations, *runner,
                                                             [this](const std::vector<Camera>& cameras) {
                                                                 if (body_fit) body_fit->set_cameras(cameras);
                                                                 camera_watch->reset(cameras);
                                                                 quality.set_cameras(cameras);
                                                                 if (background_work_started_)
                                                                     build_pose_database(cameras);
                                                             });
    if (const absl::Status restored = active_calibration->restore(); !restored.ok())
        spdlog::warn("using the source's own calibration: {}", std::string(restored.message()));
}

// On the posing thread.
void Capture::observe(const FrameResult& result) {
    statistics.observe(result.times);
    if (result.frame_set.recorded_frame) {  // a replay shows nothing about the cameras and the subject
        if (const auto control = runner->subject_control()) replayed_names.observe(result, *control);
        return;
    }
    camera_watch->observe(result);
    const BodyOf body_of = [this](std::uint32_t subject_id) { return this->body_of(subject_id); };
    quality.observe(result, body_of);
    recorder->observe(result, body_of);
    if (body_fit) fit_bodies(result);
    if (faint) choose_segmentation(result);
}

// Clothes in the background's colours; `kinevox process` processes such sessions twice.
void Capture::choose_segmentation(const FrameResult& result) {
    std::vector<double> residuals_m;
    for (const SubjectResult& subject : result.subjects) {
        if (!subject.pose) continue;
        const std::uint32_t id = subject.track.subject_id;
        if (body_fit->body_in_use(id).std_m == 0 && !body_fit->awaits_refit(id))
            residuals_m.push_back(subject.pose->contour_residual_rms_m);
    }
    const auto report = quality.report();
    // A given body may be another person's, which only the report shows.
    const bool explained = report ? !quality::may_lack_parts(report->causes) : !config.pose.body_file.empty();
    using Change = quality::FaintSwitch::Change;
    const Change change = faint->update(result.capture_time_ns, residuals_m, explained);
    if (change == Change::kNone) return;
    const auto mm = [](double m) { return 1000 * m; };
    hub.events().publish(
        EventKind::kSegmentationChanged,
        change == Change::kTry
            ? fmt::format("silhouettes may lack parts of the subject (contour residual {:.0f} mm): trying "
                          "segmentation.judge_faint",
                          mm(faint->residual_before_m()))
            : fmt::format("segmentation.judge_faint is {}: contour residual {:.0f} mm, {:.0f} mm without it",
                          change == Change::kKeep ? "kept" : "off again", mm(faint->residual_after_m()),
                          mm(faint->residual_before_m())));
    if (change == Change::kKeep) return;
    live_pipeline->set_judge_faint(faint->judges_faint());
    quality.set_judge_faint(faint->judges_faint());
    change == Change::kTry ? body_fit->refit() : body_fit->undo_refit();
}

const BodyShape* Capture::body_of(std::uint32_t subject_id) const {
    if (!pose_stage) return nullptr;
    if (!options.tracker.several_subjects()) return &pose_stage->body();
    if (subject_id == 0) return &options.posing.body;
    const PoseStage* const stage = live_pipeline->pose_stage_of(subject_id);
    return stage ? &stage->body() : nullptr;
}

void Capture::fit_bodies(const FrameResult& result) {
    std::vector<LiveBodyFit::Seen> tracked;
    for (const SubjectResult& subject : result.subjects) {
        const PoseStage* const stage = live_pipeline->pose_stage_of(subject.track.subject_id);
        LiveBodyFit::Seen& seen = tracked.emplace_back();
        seen.subject_id = subject.track.subject_id;
        if (!subject.volume || !stage) continue;
        seen.observation = &stage->observation();
        if (stage->tracked()) seen.posture = &stage->tracked()->fit.posture;
    }
    body_fit->observe(result.capture_time_ns, tracked);
    const auto use_fitted = [&](std::uint32_t subject_id, PoseStage& stage) {
        const BodyInUse body = body_fit->body_in_use(subject_id);
        if (stage.body() != body.shape) stage.set_body(body);
    };
    // A single subject's body stays when the subject is lost; the stages of several serve new ones.
    if (!options.tracker.several_subjects()) return use_fitted(0, *pose_stage);
    for (const SubjectResult& subject : result.subjects)
        if (PoseStage* const stage = live_pipeline->pose_stage_of(subject.track.subject_id))
            use_fitted(subject.track.subject_id, *stage);
}

void Capture::build_pose_database(const std::vector<Camera>& cameras) {
    if (poses)
        start_pose_database(*poses, config.pose, cameras, options.posing.body, hub.events(), pose_watch);
}

void Capture::start_background_work() {
    background_work_started_ = true;
    build_pose_database(runner->cameras());
}

void Capture::notify_shutdown(const absl::Status& why) {
    runner->abort();
    if (poses) poses->close();
    if (body_fit) body_fit->close();
    camera_watch->close();
    procedure->close();
    hub.close(why);
    pose_watch.close(why);
    body_watch.close(why);
    procedure_watch.close(why);
}

void Capture::stop() {
    runner->stop().IgnoreError();  // FailedPrecondition if nothing is captured
}

void Capture::close() {
    recorder->close();  // finishes the current recording
    procedure.reset();  // its thread ends at its next step
    body_fit.reset();   // its thread ends at its next frame set
    poses.reset();      // its thread ends at its next check
}

metrics::MetricsSnapshot Capture::metrics_snapshot() const {
    metrics::MetricsSnapshot out;
    out.version = KINEVOX_VERSION;
    out.source = describe(config.source);
    out.start_time_s = std::chrono::duration<double>(started_at_.time_since_epoch()).count();
    out.state = runner->state().state;
    out.nominal_fps = runner->source_fps();
    out.run = runner->snapshot();
    const auto latest = hub.latest();
    if (const FrameResult* const result = latest ? latest->result.get() : nullptr) {
        out.subjects_tracked = static_cast<int>(result->subjects.size());
        for (const SubjectResult& subject : result->subjects) {
            if (subject.pose) ++out.subjects_with_pose;
            if (subject.volume)
                out.subject_volumes_litres.emplace_back(subject.track.subject_id,
                                                        volume_litres(*subject.volume));
        }
    }
    out.stages_s = {{"segmentation", statistics.segmentation.read()},
                    {"tracking", statistics.tracking.read()},
                    {"hull", statistics.hull.read()},
                    {"colouring", statistics.colouring.read()},
                    {"pose", statistics.pose.read()},
                    {"total", statistics.total.read()}};
    const StreamHub::Subscribers subscribers = hub.subscribers();
    const auto stream = [](const char* name, int count, const StreamStatistics& each) {
        return metrics::StreamMetrics{name, count, each.latency.read(), each.sent, each.missed};
    };
    out.streams = {stream("volumes", subscribers.volumes, statistics.volumes),
                   stream("poses", subscribers.poses, statistics.poses),
                   stream("previews", subscribers.images, statistics.images),
                   {"events", subscribers.events, std::nullopt, 0, 0}};
    const std::vector<Camera> cameras = runner->cameras();
    const std::vector<CameraConnection> connections = runner->camera_connections();
    std::vector<WatchedCamera> watched;
    if (!replay->status().open) watched = camera_watch->cameras();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        metrics::CameraMetrics& camera = out.cameras.emplace_back();
        camera.name = cameras[c].name;
        if (c < connections.size()) camera.connection = connections[c];
        if (latest) camera.silhouette_iou = min_silhouette_iou(*latest->result, c);
        if (c < watched.size()) {
            camera.scene_shift_px = watched[c].shift_px;
            camera.calibration_suspect = watched[c].suspect;
        }
    }
    if (!recorder->options().folder.empty()) {
        const RecorderStatus status = recorder->status();
        out.recorder = {status.state != RecorderState::kIdle, status.free_bytes, status.queued_bytes,
                        status.buffered_s};
    }
    out.gpu_configured = gpu != nullptr;
    if (gpu) out.gpu = gpu->state();
    return out;
}

}  // namespace kinevox
