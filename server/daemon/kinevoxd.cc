// kinevoxd: the capture daemon. serve() shows its parts, the order in which they start and the reverse order
// in which they stop; docs/threads.md lists which thread may call what.
#include "server/daemon/kinevoxd.h"

#include <absl/synchronization/mutex.h>
#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/signal_set.hpp>
#include <csignal>
#include <cstdio>

#include "common/command_line.h"
#include "common/host_port.h"
#include "server/cameras/session_source.h"
#include "server/config/daemon_config.h"
#include "server/daemon/access_setup.h"
#include "server/daemon/capture.h"
#include "server/daemon/service_timer.h"
#include "server/daemon/services.h"
#include "server/daemon/setup.h"
#include "server/daemon/timers.h"
#include "server/pipeline/pipeline_resources.h"

namespace {

using namespace kinevox;
namespace asio = boost::asio;

// Destroyed after everything that logs.
struct LogEnd {
    ~LogEnd() { spdlog::shutdown(); }
};

int fail(std::string message) {
    std::ranges::replace(message, '\n', ' ');
    fmt::print(stderr, "kinevoxd: {}\n", message);
    return 1;
}

int fail(const absl::Status& status) {
    return fail(std::string(status.message()));
}

// Everything that acts at intervals, on the io_context.
struct Timers {
    Timers(asio::io_context& io, Capture& capture, Services& services)
        : status_log(io, *capture.runner, capture.hub),
          lease(io, services.lease, capture.hub.events()),
          service(io, *capture.runner, capture.gpu.get()),
          retention(io, services.recordings.get_executor(), retention_limits(capture.config.recording),
                    *capture.recorder, *capture.replay, capture.hub.events()),
          guard(io, *services.access.guard) {}

    StatusLog status_log;
    LeaseTimer lease;
    ServiceTimer service;
    RetentionTimer retention;
    GuardTimer guard;

    // All but the service manager's, which is stopped first.
    void stop() {
        retention.stop();
        guard.stop();
        lease.stop();
        status_log.stop();
    }
};

void stop_on_signals(asio::io_context& io, asio::signal_set& signals) {
    signals.async_wait([&](const boost::system::error_code&, int signal) {
        spdlog::info("stopping on {}", signal == SIGINT ? "SIGINT" : "SIGTERM");
        signals.async_wait([](const boost::system::error_code&, int) {});  // a second one has no effect
        io.stop();
    });
}

void announce(const DaemonConfig& config, int port) {
    HostPort address =
        parse_host_port(config.server.listen).value_or(HostPort{});  // checked when it was read
    address.port = port;
    fmt::print("ready on {}\n", address.to_string());
    std::fflush(stdout);
    spdlog::info("kinevoxd {} serves {} on {}", KINEVOX_VERSION, describe(config.source),
                 address.to_string());
}

int serve(const DaemonConfig& given, bool insecure, const MakeGpu& make_gpu) {
    asio::io_context io(1);
    asio::signal_set signals(io, SIGTERM, SIGINT);  // first, so that an early one is not lost

    // Everything that can fail, before the daemon reports that it is ready.
    if (const absl::Status logging = set_up_logging(given.log); !logging.ok()) return fail(logging);
    const LogEnd log_end;
    auto access = AccessSetup::create(given.server, insecure);
    if (!access.ok()) return fail(access.status());
    raise_open_files_limit();
    std::optional<oneapi::tbb::global_control> compute_threads;
    if (given.pipeline.threads > 0)
        compute_threads.emplace(oneapi::tbb::global_control::max_allowed_parallelism,
                                static_cast<std::size_t>(given.pipeline.threads));
    const auto capture = Capture::create(with_fitted_body(given), make_gpu);
    if (!capture.ok()) return fail(capture.status());
    Services services(io, **capture, *access);
    if (const absl::Status listening = services.listen(); !listening.ok()) return fail(listening);

    // Nothing runs by itself until here; from here a signal ends io.run().
    Timers timers(io, **capture, services);
    stop_on_signals(io, signals);
    asio::post(services.control, [&] { (*capture)->start_background_work(); });
    if (given.source.autostart)
        asio::post(services.control,
                   [&] { (*capture)->runner->start().IgnoreError(); });  // an error is an event and a state
    services.server->set_serving(true);
    announce(given, services.server->port());
    timers.service.ready();
    io.run();

    timers.service.stop();
    services.reject_calls();
    (*capture)->notify_shutdown(absl::UnavailableError("the daemon is stopping; connect again later"));
    services.end_calls();
    (*capture)->stop();
    services.join_encoders();
    (*capture)->close();
    timers.stop();
    spdlog::info("stopped");
    return 0;
}

}  // namespace

int kinevox::run_kinevoxd(int argc, char** argv, const MakeGpu& make_gpu) {
    restart_with_huge_pages(argv);
    std::signal(SIGPIPE, SIG_IGN);
    // Debian builds Abseil with deadlock detection, which slows every mutex of gRPC down.
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
    std::string config_file;
    CLI::App app(
        "Kinevox capture daemon. Without a configuration it serves the virtual studio on 127.0.0.1:50770.",
        "kinevoxd");
    app.add_option("--config", config_file,
                   "TOML configuration file; deploy/kinevoxd.toml documents every key");
    bool insecure = false;
    app.add_flag(kInsecureFlag, insecure,
                 "Serve on the network without TLS and tokens; everyone there may watch, record and delete");
    app.set_version_flag("--version", std::string("kinevoxd ") + KINEVOX_VERSION);
    if (const auto ended = parse_command_line(app, argc, argv)) return *ended;
    DaemonConfig config;
    if (!config_file.empty()) {
        auto read = read_config(config_file);
        if (!read.ok()) return fail(read.status());
        config = std::move(*read);
    }
    silence_video_libraries();
    try {
        return serve(config, insecure, make_gpu);
    } catch (const std::exception& error) {
        return fail(fmt::format("unexpected error: {}", error.what()));
    }
}
