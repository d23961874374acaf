// The commands of `kinevox`. Each registers itself as a subcommand; what it does is run by the function it
// stores in `run`, whose error becomes one line on stderr and exit status 1.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <string>

#include "client/lib/connection_options.h"
#include "client/lib/stop_signals.h"

namespace CLI {
class App;
}

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
void add_poses_verb(CLI::App& app, GlobalOptions& global, Run& run);   // list, add, delete, import, watch
void add_body_verb(CLI::App& app, GlobalOptions& global, Run& run);    // show, fit
void add_replay_verb(CLI::App& app, GlobalOptions& global, Run& run);  // open, close, play, pause, step, ...
void add_record_verb(CLI::App& app, GlobalOptions& global, Run& run);  // start, stop, save, export, ...
void add_calibrate_verb(CLI::App& app, GlobalOptions& global, Run& run);  // those with a daemon

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

}  // namespace kinevox::cli
