// kinevox: the daemon's command line, and the door to the tools that need none.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <grpc/support/log.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>

#include "client/cli/calibrate_verb.h"
#include "client/cli/export_verb.h"
#include "client/cli/external_verbs.h"
#include "client/cli/verbs.h"

namespace {

using namespace kinevox::cli;

int fail(std::string message) {
    for (char& c : message)
        if (c == '\n') c = ' ';
    fmt::print(stderr, "kinevox: {}\n", message);
    return 1;
}

bool is_own_verb(CLI::App& app, const std::string& verb) {
    const auto own = app.get_subcommands([&](const CLI::App* sub) { return sub->get_name() == verb; });
    return !own.empty();
}

}  // namespace

int main(int argc, char** argv) {
    std::signal(SIGPIPE, SIG_IGN);                    // a closed pipe is noticed where it is written to
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors come back as statuses; one line each is enough

    Common common;
    Run run;
    CLI::App app("Kinevox: markerless motion capture. Talks to a running kinevoxd.", "kinevox");
    app.require_subcommand(1);
    app.set_version_flag("--version", std::string("kinevox ") + KINEVOX_VERSION);
    app.failure_message([](const CLI::App*, const CLI::Error& error) { return std::string(error.what()); });
    add_status_verbs(app, common, run);
    add_control_verbs(app, common, run);
    add_watch_verb(app, common, run);
    add_events_verb(app, common, run);
    add_stream_verb(app, common, run);
    add_snapshot_verb(app, common, run);
    add_poses_verb(app, common, run);
    add_body_verb(app, common, run);
    add_replay_verb(app, common, run);
    add_calibrate_verb(app, common, run);
    add_record_verb(app, common, run);
    add_export_verb(app, common, run);

    // An unknown verb is somebody else's, and so is one that works on files.
    const std::vector<std::string> rest{argv + std::min(argc, 2), argv + argc};
    const bool on_files = argc > 1 && ((argv[1] == std::string("calibrate") && !wants_a_daemon(rest)) ||
                                       (argv[1] == std::string("export") && !exports_recording(rest)));
    if (argc > 1 && argv[1][0] != '-' && (on_files || !is_own_verb(app, argv[1]))) {
        if (const auto program = find_external_verb(argv[1]))
            return fail(run_external_verb(*program, argv + 1));
        return fail(fmt::format("there is no verb '{}'; see `kinevox --help`", argv[1]));
    }
    if (const auto others = external_verbs(); !others.empty())
        app.footer(fmt::format("Verbs that need no daemon: {}. `kinevox VERB --help` tells more.",
                               fmt::join(others, ", ")));

    try {
        app.parse(argc, argv);
        absl::Status status = common.open();
        if (status.ok()) status = run();
        return status.ok() ? 0 : fail(std::string(status.message()));
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
        return fail(std::string(error.what()) + "; see `kinevox --help`");
    } catch (const std::exception& error) {
        return fail(error.what());
    }
}
