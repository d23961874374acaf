#include "server/daemon/services.h"

#include <spdlog/spdlog.h>

#include "common/background_priority.h"
#include "common/host_port.h"
#include "server/daemon/access_setup.h"
#include "server/daemon/setup.h"

namespace kinevox {
namespace {

// Relative to the capture: the service manager's priority is for the capture, which thousands of subscribers
// would slow down otherwise.
constexpr int kServingNice = 10;

}  // namespace

absl::StatusOr<AccessSetup> AccessSetup::create(const ServerConfig& config, bool insecure) {
    if (absl::Status accessible = check_network_access(config, insecure); !accessible.ok()) return accessible;
    auto server_options = api_server_options(config.access);
    if (!server_options.ok()) return server_options.status();
    auto audit = open_audit_log(config.access);
    if (!audit.ok()) return audit.status();
    auto guard = make_guard(config.access, audit->get());
    if (!guard.ok()) return guard.status();
    if (!is_loopback(config.listen) && (*guard)->open())
        spdlog::warn("everyone who can connect to {} has full access", config.listen);
    return AccessSetup{*std::move(server_options), *std::move(audit), *std::move(guard)};
}

Services::Services(boost::asio::io_context& io, Capture& serving, AccessSetup& setup)
    : capture(serving),
      access(setup),
      lease(lease_options(capture.config.control)),
      fair_share(max_latest_messages_per_s(capture.config.stream)) {
    with_nicer_threads(kServingNice, [&] { encoders.emplace(2); });
    api.emplace(ApiContext{.runner = *capture.runner,
                           .hub = capture.hub,
                           .lease = lease,
                           .threads = {.control = control.get_executor(),
                                       .encoders = encoders->get_executor(),
                                       .timers = io.get_executor(),
                                       .changes = changes.get_executor(),
                                       .calibrating = calibrating.get_executor(),
                                       .recordings = recordings.get_executor(),
                                       .exports = exports.get_executor()},
                           .poses = {.database = capture.poses ? &*capture.poses : nullptr,
                                     .database_watch = &capture.pose_watch,
                                     .body_fit = capture.body_fit.get(),
                                     .body_watch = &capture.body_watch},
                           .calibration = {.store = capture.calibrations.get(),
                                           .active = capture.active_calibration.get(),
                                           .procedure = capture.procedure.get(),
                                           .procedure_watch = &capture.procedure_watch,
                                           .camera_watch = capture.camera_watch.get()},
                           .streams = stream_settings(capture.config.stream, fair_share),
                           .recorder = capture.recorder.get(),
                           .replay = capture.replay.get(),
                           .replay_folders = capture.config.replay.folders,
                           .quality = &capture.quality,
                           .statistics = &capture.statistics,
                           .guard = access.guard.get(),
                           .gpu = capture.gpu.get(),
                           .source_description = describe(capture.config.source)});
    if (capture.config.source.kind == SourceConfig::Kind::kSession)
        api->replay_folders.push_back(capture.config.source.session_file.parent_path());
}

absl::Status Services::listen() {
    absl::StatusOr<std::unique_ptr<ApiServer>> listening;
    with_nicer_threads(kServingNice, [&] {
        listening = ApiServer::listen(capture.config.server.listen, *api, access.server_options);
    });
    if (!listening.ok()) return listening.status();
    server = *std::move(listening);
    if (capture.config.metrics.listen.empty()) return absl::OkStatus();
    auto prometheus =
        metrics::HttpEndpoint::listen(capture.config.metrics.listen, [this](metrics::Format format) {
            return metrics::capture_metrics(capture.metrics_snapshot(), format);
        });
    if (!prometheus.ok()) return prometheus.status();
    endpoint = *std::move(prometheus);
    spdlog::info("metrics on port {}", endpoint->port());
    return absl::OkStatus();
}

void Services::reject_calls() {
    endpoint.reset();
    server->set_serving(false);
}

void Services::end_calls() {
    server->shutdown(std::chrono::milliseconds(700));
    control.join();  // a start or stop in progress
    changes.join();
    calibrating.join();
    recordings.join();
    exports.join();
}

}  // namespace kinevox
