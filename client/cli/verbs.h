// The commands of `kinevox`. Each registers itself as a subcommand; what it does is run by the function it
// stores in `run`, whose error becomes one line on stderr and exit status 1.
#pragma once

#include <absl/status/status.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "client/lib/client_program.h"

namespace kinevox::cli {

// Of all commands, before and after the command's name. Filled when the command line is parsed.
struct GlobalOptions {
    client::ConnectionOptions connection;
    double timeout_s = 5;
    bool json = false;

    // Reads the files that the connection needs; before the command runs.
    absl::Status open();
    client::ClientOptions client_options() const;

  private:
    client::ClientOptions opened_;
};

// Adds them to the app itself, once and before its subcommands; see add_connection_options().
void add_global_options(CLI::App& app, GlobalOptions& global);
// Lists them at the end of the help of every subcommand, whose own options come first.
void show_global_options_in_help(CLI::App& app);

// What the parsed command does.
using Run = std::function<absl::Status()>;

void add_status_verbs(CLI::App& app, GlobalOptions& global, Run& run);   // status, cameras
void add_control_verbs(CLI::App& app, GlobalOptions& global, Run& run);  // start, stop, learn-background
void add_watch_verb(CLI::App& app, GlobalOptions& global, Run& run);
void add_events_verb(CLI::App& app, GlobalOptions& global, Run& run);
void add_stream_verb(CLI::App& app, GlobalOptions& global, Run& run);  // volumes, angles, joints, coordinates
void add_snapshot_verb(CLI::App& app, GlobalOptions& global, Run& run);
void add_poses_verb(CLI::App& app, GlobalOptions& global, Run& run);     // list, add, delete, import, watch
void add_body_verb(CLI::App& app, GlobalOptions& global, Run& run);      // show, fit
void add_subjects_verb(CLI::App& app, GlobalOptions& global, Run& run);  // list, follow, ignore, name
void add_replay_verb(CLI::App& app, GlobalOptions& global, Run& run);  // open, close, play, pause, step, ...
void add_record_verb(CLI::App& app, GlobalOptions& global, Run& run);  // start, stop, save, export, ...
void add_calibrate_verb(CLI::App& app, GlobalOptions& global, Run& run);  // those with a daemon

// Parts of the commands above that are in files of their own.
void add_record_export_verb(CLI::App& record, GlobalOptions& global, Run& run);
void add_start_verb(CLI::App& calibrate, GlobalOptions& global, Run& run);  // the guided procedure
void add_pose_streams(CLI::App& stream, GlobalOptions& global,
                      Run& run);  // stream angles, joints, coordinates

// The commands of the program kinevox-calibrate, which works on files: intrinsics, extrinsics, floor, ...
bool is_calibrate_file_command(const std::string& name);

// --operator: under which name a command acquires control.
void add_operator_option(CLI::App& command, std::string& operator_name);
// "user@host".
std::string default_operator_name();

// --yes: for commands that delete. confirm_deletion() asks on a terminal whether to delete `what`, unless it
// is given; elsewhere it is an error that names the option.
void add_yes_option(CLI::App& command, bool& yes);
absl::Status confirm_deletion(bool yes, const std::string& what);

// --overwrite: for commands that write files. check_overwrite() is an error where `file` is a file or a
// folder that is not empty and the option is not given.
void add_overwrite_option(CLI::App& command, bool& overwrite);
absl::Status check_overwrite(bool overwrite, const std::string& file);

using client::stop_on_signals;

// Writes a line to stdout at once. False when nothing reads it any more.
bool print_line(const std::string& line);

// Adds a subcommand, such as `kinevox status` or `kinevox poses list`, to the app or to a group; when it is
// parsed, `act` is what runs, with `options` as parsed.
template <class Options>
CLI::App* add_action(CLI::App& parent, GlobalOptions& global, Run& run,
                     const std::shared_ptr<Options>& options, const char* name, const char* help,
                     absl::Status (*act)(const GlobalOptions&, const Options&)) {
    CLI::App* action = parent.add_subcommand(name, help);
    action->callback(
        [&global, &run, options, act] { run = [&global, options, act] { return act(global, *options); }; });
    return action;
}

// `kinevox COMMAND` starts the program kinevox-COMMAND, as git does: the tools that need the pipeline but no
// daemon are programs of their own, so that this client needs neither OpenCV nor the kernels.
// Searched for next to this executable, in ../lib/kinevox, where the build tree has it, then on PATH.
std::optional<std::filesystem::path> find_external_verb(const std::string& verb);

// Their names without "kinevox-", sorted.
std::vector<std::string> external_verbs();

// Replaces this process. Returns only if that fails, with the reason.
std::string run_external_verb(const std::filesystem::path& program, std::vector<std::string> arguments);

}  // namespace kinevox::cli
