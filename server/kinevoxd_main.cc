// kinevoxd: the capture daemon. This page shows all parts, the order in which they start, and the reverse
// order in which they stop; docs/threads.md tells which thread may call what.
#include <absl/synchronization/mutex.h>
#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/thread_pool.hpp>
#include <csignal>
#include <cstdio>
#include <thread>

#include "common/background_priority.h"
#include "common/config.h"
#include "common/loopback.h"
#include "server/api/api_server.h"
#include "server/api/fair_share.h"
#include "server/api/version.h"
#include "server/calibration/camera_watch.h"
#include "server/cameras/session_source.h"
#include "server/daemon/access_setup.h"
#include "server/daemon/clocks.h"
#include "server/daemon/kinevoxd.h"
#include "server/daemon/service_clock.h"
#include "server/daemon/setup.h"
#include "server/daemon/stored_background.h"
#include "server/metrics/capture_figures.h"
#include "server/metrics/capture_metrics.h"
#include "server/metrics/http_endpoint.h"
#include "server/pipeline/gpu.h"
#include "server/pipeline/huge_pages.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"
#include "server/pipeline/utc_clock.h"
#include "server/pose/pose_stage.h"

namespace {

using namespace kinevox;
namespace asio = boost::asio;

// Nothing may log any more.
struct LogEnd {
    ~LogEnd() { spdlog::shutdown(); }
};

// Where the service manager gives the daemon priority, it is for the capture: a thousand watchers would
// otherwise slow it down, and on one machine starve themselves of what they are sent.
constexpr int kServingNicer = 10;
using MakeGpu = std::function<std::unique_ptr<const kernels::StageMaker>()>;

int fail(std::string message) {
    std::ranges::replace(message, '\n', ' ');
    fmt::print(stderr, "kinevoxd: {}\n", message);
    return 1;
}

int fail(const absl::Status& status) {
    return fail(std::string(status.message()));
}

int serve(const DaemonConfig& given, bool serve_everyone, const MakeGpu& make_gpu) {
    // Signals first, so that one that comes early is not lost.
    asio::io_context io(1);
    asio::signal_set signals(io, SIGTERM, SIGINT);

    // What can fail, before anyone is told that the daemon is there.
    if (const absl::Status logging = set_up_logging(given.log); !logging.ok()) return fail(logging);
    const LogEnd
        after_all_below;  // cameras and the stored background have threads until they are destroyed, and log
    const DaemonConfig config = with_fitted_body(given);
    StoredBackground background(background_folder(config),
                                [](const std::string& what) { spdlog::info("{}", what); });
    const auto open = [&config, &background]() -> absl::StatusOr<std::unique_ptr<FrameSource>> {
        auto source = open_source(config.source);
        if (!source.ok()) return source;
        return background.restoring(*std::move(source));
    };
    if (const absl::Status reach = check_reach(config.server, serve_everyone); !reach.ok())
        return fail(reach);
    const auto server_options = api_server_options(config.server.access);
    if (!server_options.ok()) return fail(server_options.status());
    const auto audit = open_audit_log(config.server.access);
    if (!audit.ok()) return fail(audit.status());
    const auto guard = make_guard(config.server.access, audit->get());
    if (!guard.ok()) return fail(guard.status());
    if (!is_loopback(config.server.listen) && (*guard)->open())
        spdlog::warn("everyone who reaches {} may do everything", config.server.listen);
    raise_open_files_limit();
    std::optional<oneapi::tbb::global_control> compute_threads;
    if (config.pipeline.threads > 0)
        compute_threads.emplace(oneapi::tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(config.pipeline.threads));
    auto source = open();
    if (!source.ok()) return fail(source.status());
    auto options = pipeline_options(config);
    if (!options.ok()) return fail(options.status());
    const std::shared_ptr<Gpu> gpu =
        options->device == kernels::Device::kCuda ? std::make_shared<Gpu>(make_gpu()) : nullptr;
    options->gpu = gpu;
    auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), *options);
    if (!pipeline.ok()) return fail(pipeline.status());

    // The capture, and the poses that it may start from.
    StreamHub hub;
    DatabaseWatch pose_watch;
    std::optional<PoseDatabaseService> poses;
    if (const auto file = pose_database_file(config.pose); !file.empty()) {
        poses.emplace(file);
        (*pipeline)->pose_stage()->set_proposer(&*poses);  // has nothing to propose until it is built
    }
    ControlLease lease(lease_options(config.control));
    PoseStage* const pose_stage = (*pipeline)->pose_stage();
    Runner runner(std::move(*source), open, std::move(*pipeline), hub);
    BodyWatch body_watch;
    std::unique_ptr<LiveBodyFit> body_fit;
    if (pose_stage) {
        body_fit =
            make_body_fit(config.pose, runner, options->posing, poses ? &*poses : nullptr, hub, body_watch);
    }
    CameraWatch camera_watch(runner.cameras(), {},
                             [&hub](const Event& event) { hub.publish_event(event, utc_now_ns()); });
    std::unique_ptr<Recorder> recorder;
    metrics::CaptureFigures figures;
    runner.set_after_result([&](const FrameResult& result) {
        figures.observe(result.times);
        if (result.frame_set.recorded_frame)
            return;  // a replay teaches nothing of the cameras and who is before them
        camera_watch.observe(result);
        recorder->observe(result, pose_stage ? &pose_stage->body() : nullptr);
        if (!body_fit) return;
        body_fit->observe(result.capture_time_ns,
                          result.subject && result.volume ? &pose_stage->observation() : nullptr);
        if (const auto body = body_fit->take_body()) pose_stage->set_body(*body);
    });

    // The calibration that was applied last, in the place of the source's own; and the way to another one.
    CalibrationStore calibrations(calibration_folder(config.calibration), describe(config.source),
                                  runner.cameras());
    bool serving = false;  // the control thread's
    CalibrationUse calibration_use(calibrations, runner, [&](const std::vector<Camera>& cameras) {
        if (body_fit) body_fit->set_cameras(cameras);
        camera_watch.begin_anew(cameras);
        if (poses && serving)
            start_pose_database(*poses, config.pose, cameras, options->posing.body, hub, pose_watch);
    });
    if (const absl::Status applied = calibration_use.begin(); !applied.ok())
        spdlog::warn("the source's own calibration is used: {}", std::string(applied.message()));
    auto made_recorder = make_recorder(config, runner, calibrations, calibration_use, hub);
    if (!made_recorder.ok()) return fail(made_recorder.status());
    recorder = *std::move(made_recorder);
    runner.set_taps({[&](const FrameSet& frame_set) { recorder->offer(frame_set); },
                     [&](const EmptyScene& pictures) {
                         background.store(runner.cameras(), runner.source_fps(), pictures);
                         recorder->learned(pictures);
                     },
                     [&] { recorder->capture_ended(); }});
    Replay replay(runner, make_replay_pipeline(*options, runner, poses ? &*poses : nullptr),
                  [&hub](std::string what) {
                      hub.publish_event({EventKind::kReplay, 0, 0, {}, std::move(what)}, utc_now_ns());
                  });
    ProcedureWatch procedure_watch;
    std::unique_ptr<CalibrationProcedure> procedure =
        make_calibration_procedure(calibrations, hub, procedure_watch);

    // The threads that serve it, and the services.
    asio::thread_pool control(1);               // start, stop and learning
    asio::thread_pool changes(1);               // of the pose database
    asio::thread_pool calibrating(1);           // calibrations' files
    asio::thread_pool recordings(1);            // recordings' files
    asio::thread_pool exports(1);               // in other programs' formats
    std::optional<asio::thread_pool> encoders;  // volumes and pictures, and the streams' writes
    with_nicer_threads(kServingNicer, [&] { encoders.emplace(2); });
    FairShare share(newest_per_s(config.stream));
    ApiContext api{.runner = runner,
                   .hub = hub,
                   .lease = lease,
                   .control = control.get_executor(),
                   .encoders = encoders->get_executor(),
                   .clock = io.get_executor(),
                   .poses = poses ? &*poses : nullptr,
                   .pose_watch = &pose_watch,
                   .changes = changes.get_executor(),
                   .body_fit = body_fit.get(),
                   .body_watch = &body_watch,
                   .calibrations = &calibrations,
                   .calibration_use = &calibration_use,
                   .procedure = procedure.get(),
                   .procedure_watch = &procedure_watch,
                   .calibrating = calibrating.get_executor(),
                   .recorder = recorder.get(),
                   .recordings = recordings.get_executor(),
                   .exports = exports.get_executor(),
                   .camera_watch = &camera_watch,
                   .figures = &figures,
                   .replay = &replay,
                   .guard = guard->get(),
                   .share = &share,
                   .gpu = gpu.get(),
                   .source_description = describe(config.source)};
    apply(config.stream, api);
    absl::StatusOr<std::unique_ptr<ApiServer>> server;
    with_nicer_threads(kServingNicer,
                       [&] { server = ApiServer::listen(config.server.listen, api, *server_options); });
    if (!server.ok()) return fail(server.status());
    std::unique_ptr<metrics::HttpEndpoint> endpoint;
    if (!config.metrics.listen.empty()) {
        auto listening = metrics::HttpEndpoint::listen(config.metrics.listen, [&api](metrics::Format format) {
            return metrics::capture_metrics(api, format);
        });
        if (!listening.ok()) return fail(listening.status());
        endpoint = *std::move(listening);
        spdlog::info("metrics on port {}", endpoint->port());
    }

    // The clocks. Until here nothing ran by itself; from here on a signal ends io.run().
    StatusLog status_log(io, runner, hub);
    LeaseClock lease_clock(io, lease, hub);
    ServiceClock service_clock(io, runner, gpu.get());
    RetentionClock retention_clock(io, recordings.get_executor(), retention_limits(config.recording),
                                   *recorder, replay, hub);
    GuardClock guard_clock(io, **guard);
    signals.async_wait([&](const boost::system::error_code&, int signal) {
        spdlog::info("stopping on {}", signal == SIGINT ? "SIGINT" : "SIGTERM");
        signals.async_wait([](const boost::system::error_code&, int) {});  // a second one changes nothing
        io.stop();
    });
    asio::post(control, [&] {  // where calibrations are applied, too
        serving = true;
        if (poses)
            start_pose_database(*poses, config.pose, runner.cameras(), options->posing.body, hub, pose_watch);
    });
    if (config.source.autostart)
        asio::post(control, [&runner] { runner.start().IgnoreError(); });  // an error is an event and a state

    (*server)->set_serving(true);
    const std::string host = config.server.listen.substr(0, config.server.listen.rfind(':'));
    fmt::print("ready on {}:{}\n", host, (*server)->port());
    std::fflush(stdout);
    spdlog::info("kinevoxd {} serves {} on {}:{}", kVersion, describe(config.source), host,
                 (*server)->port());
    service_clock.ready();
    io.run();

    // Backwards. First all that waits is told, so that nothing below waits long.
    service_clock.stop();
    endpoint.reset();
    (*server)->set_serving(false);
    runner.abort();
    if (poses) poses->close();
    if (body_fit) body_fit->close();
    camera_watch.close();
    procedure->close();
    const absl::Status stopping = absl::UnavailableError("the daemon is stopping; connect again later");
    hub.close(stopping);
    pose_watch.close(stopping);
    body_watch.close(stopping);
    procedure_watch.close(stopping);
    (*server)->shutdown(std::chrono::milliseconds(700));  // streams end with the words above
    control.join();                                       // a start or stop in progress
    changes.join();
    calibrating.join();
    recordings.join();
    exports.join();
    runner.stop().IgnoreError();  // its threads; FailedPrecondition if nothing runs
    encoders->join();
    recorder->close();  // what is being recorded is finished
    procedure.reset();  // its thread ends at its next step
    body_fit.reset();   // its thread ends at its next frame set
    poses.reset();      // its thread ends as soon as it sees that it is to end
    retention_clock.stop();
    guard_clock.stop();
    lease_clock.stop();
    status_log.stop();
    spdlog::info("stopped");
    return 0;
}

}  // namespace

int kinevox::run_kinevoxd(int argc, char** argv, const MakeGpu& make_gpu) {
    kinevox::restart_with_huge_pages(argv);
    std::signal(SIGPIPE, SIG_IGN);
    // Debian builds Abseil with its search for deadlocks, which every mutex of gRPC pays for.
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
    std::string config_file;
    CLI::App app(
        "The Kinevox capture daemon. Without a configuration it serves the virtual studio on "
        "127.0.0.1:50770.",
        "kinevoxd");
    app.add_option("--config", config_file, "TOML; deploy/kinevoxd.toml explains every key");
    bool serve_everyone = false;
    app.add_flag(
        kServeEveryoneFlag, serve_everyone,
        "Serve beyond this machine without TLS and tokens: everyone on the network may watch, record and "
        "delete");
    app.set_version_flag("--version", std::string("kinevoxd ") + kVersion);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        return error.get_exit_code() == 0 ? app.exit(error)
                                          : fail(std::string(error.what()) + "; see kinevoxd --help");
    }
    DaemonConfig config;
    if (!config_file.empty()) {
        auto read = read_config(config_file);
        if (!read.ok()) return fail(read.status());
        config = std::move(*read);
    }
    silence_video_libraries();
    try {
        return serve(config, serve_everyone, make_gpu);
    } catch (const std::exception& error) {
        return fail(fmt::format("ends on an error nobody expected: {}", error.what()));
    }
}
