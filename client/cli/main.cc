// kinevox: the command line of the daemon, and the entry to the local tools.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <grpc/support/log.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>

#include "client/cli/verbs.h"
#include "common/command_line.h"

namespace {

using namespace kinevox::cli;

// The words of the command line, taken apart without parsing: which program runs is decided by the command's
// name alone.
struct CommandWords {
    std::vector<std::string> before;   // global options before the command, with their values
    std::vector<std::string> command;  // "record", "start"
    std::vector<std::string> after;    // what follows the first word of the command
};

CommandWords split_command(const CLI::App& app, const std::vector<std::string>& words) {
    CommandWords out;
    std::size_t i = 0;
    for (; i < words.size() && words[i].starts_with('-'); ++i) {
        out.before.push_back(words[i]);
        const CLI::Option* const option = app.get_option_no_throw(words[i]);
        if (option && option->get_expected_min() > 0 && i + 1 < words.size())
            out.before.push_back(words[++i]);
    }
    if (i == words.size()) return out;
    out.command.push_back(words[i]);
    out.after.assign(words.begin() + static_cast<std::ptrdiff_t>(i) + 1, words.end());
    for (++i; i < words.size(); ++i) {
        if (const CLI::Option* const option = app.get_option_no_throw(words[i])) {
            i += option->get_expected_min() > 0;
        } else if (!words[i].starts_with('-')) {
            out.command.push_back(words[i]);
            break;
        }
    }
    return out;
}

bool is_own_command(const CLI::App& app, const std::string& name) {
    return !app.get_subcommands([&](const CLI::App* sub) { return sub->get_name() == name; }).empty();
}

int run_external(const std::filesystem::path& program, const CommandWords& words) {
    std::vector<std::string> arguments{program.string()};
    arguments.insert(arguments.end(), words.after.begin(), words.after.end());
    arguments.insert(arguments.end(), words.before.begin(), words.before.end());
    return kinevox::report_failure("kinevox", run_external_verb(program, arguments));
}

}  // namespace

int main(int argc, char** argv) {
    std::signal(SIGPIPE, SIG_IGN);                    // a closed pipe is noticed where it is written to
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors come back as statuses; one line each is enough

    GlobalOptions global;
    Run run;
    CLI::App app("Kinevox: markerless motion capture. Command line of a running kinevoxd, and local tools.",
                 "kinevox");
    add_global_options(app, global);
    app.require_subcommand(1);
    app.set_version_flag("--version", std::string("kinevox ") + KINEVOX_VERSION);
    add_status_verbs(app, global, run);
    add_control_verbs(app, global, run);
    add_watch_verb(app, global, run);
    add_events_verb(app, global, run);
    add_stream_verb(app, global, run);
    add_snapshot_verb(app, global, run);
    add_poses_verb(app, global, run);
    add_body_verb(app, global, run);
    add_subjects_verb(app, global, run);
    add_replay_verb(app, global, run);
    add_calibrate_verb(app, global, run);
    add_record_verb(app, global, run);
    show_global_options_in_help(app);

    const std::vector<std::string> all_words{argv + std::min(argc, 1), argv + argc};
    const CommandWords words = split_command(app, all_words);
    const std::vector<std::string> external = external_verbs();
    if (!words.command.empty()) {
        const std::string& name = words.command.front();
        const bool on_files =
            name == "calibrate" && words.command.size() > 1 && is_calibrate_file_command(words.command[1]);
        if (on_files || !is_own_command(app, name))
            if (const auto program = find_external_verb(name)) return run_external(*program, words);
        if (on_files)
            return kinevox::report_failure("kinevox",
                                           "kinevox-calibrate is not installed; install the server package");
    }
    std::vector<std::string> local;
    for (const std::string& name : external)
        if (!is_own_command(app, name)) local.push_back(name);
    app.footer(fmt::format("{}\n{}",
                           local.empty()
                               ? ""
                               : fmt::format("Local commands (no daemon): {}. See `kinevox COMMAND --help`.",
                                             fmt::join(local, ", ")),
                           kinevox::kExitStatusHelp));
    try {
        app.parse(argc, argv);
        absl::Status status = global.open();
        if (status.ok()) status = run();
        return status.ok() ? 0 : kinevox::report_failure("kinevox", std::string(status.message()));
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
        return kinevox::report_failure("kinevox", kinevox::parse_error_text(app, all_words, error, local));
    } catch (const std::exception& error) {
        return kinevox::report_failure("kinevox", error.what());
    }
}
