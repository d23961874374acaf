// The verbs of `kinevox`. Each registers itself as a subcommand; what it does is run by the returned
// function, whose error becomes one line on stderr and exit status 1.
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

// What every verb takes. Filled when the command line is parsed.
struct Common {
    client::ConnectionOptions connection;
    double timeout_s = 5;
    bool json = false;

    // Reads the files that the connection needs; before the verb runs.
    absl::Status open();
    client::ClientOptions client_options() const;

  private:
    client::ClientOptions opened_;
};

// Adds --timeout, --json and the connection's options to a subcommand.
void add_common_options(CLI::App& verb, Common& common);

using Run = std::function<absl::Status()>;

void add_status_verbs(CLI::App& app, Common& common, Run& run);   // status, cameras
void add_control_verbs(CLI::App& app, Common& common, Run& run);  // start, stop, learn-background
void add_watch_verb(CLI::App& app, Common& common, Run& run);
void add_events_verb(CLI::App& app, Common& common, Run& run);
void add_stream_verb(CLI::App& app, Common& common, Run& run);
void add_snapshot_verb(CLI::App& app, Common& common, Run& run);
void add_poses_verb(CLI::App& app, Common& common, Run& run);   // list, add, remove, import, watch
void add_body_verb(CLI::App& app, Common& common, Run& run);    // fit, show
void add_replay_verb(CLI::App& app, Common& common, Run& run);  // open, live, play, pause, step, seek, ...

void add_record_verb(CLI::App& app, Common& common, Run& run);  // start, stop, keep, status, list, delete

void add_export_verb(CLI::App& app, Common& common, Run& run);  // of a daemon's recording

// "user@host": under which control is taken.
std::string default_operator_name();

using client::stop_on_signals;

// Writes a line to stdout at once. False when nobody reads it any more.
bool print_line(const std::string& line);

}  // namespace kinevox::cli
