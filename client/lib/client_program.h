// What the client programs' main functions share: the options that say which daemon to connect to, and how;
// SIGINT and SIGTERM as a stop token, for programs that run until they are stopped.
#pragma once

#include <stop_token>
#include <string>

#include "client/lib/client.h"

namespace CLI {
class App;
}

namespace kinevox::client {

inline constexpr const char* kGlobalOptionsGroup = "Global options";

struct ConnectionOptions {
    std::string server = kDefaultServer;
    SecurityFiles files;

    // Reads the files; the errors of read_security().
    absl::StatusOr<ClientOptions> open() const;
};

// Adds --server, --tls, --ca, --certificate, --key, --server-name and --token-file, each also from the
// environment (KINEVOX_SERVER, KINEVOX_CA, ...): the command line takes precedence over the environment, that
// over the default. Call it once per program, on the app itself and before its subcommands are added: CLI11
// lets the variables of a subcommand's options override the command line of another. The options are then
// accepted before and after a subcommand. `options` is filled when the command line is parsed.
void add_connection_options(CLI::App& app, ConnectionOptions& options);

// A token that SIGINT and SIGTERM stop; a second signal ends the program at once. The first call blocks these
// signals and starts the thread that waits for them: call it before gRPC starts threads, which would receive
// them otherwise.
std::stop_token stop_on_signals();

}  // namespace kinevox::client
