// The options of a command line that say which daemon is meant and how it is spoken to.
#pragma once

#include <string>

#include "client/lib/client.h"

namespace CLI {
class App;
}

namespace kinevox::client {

struct ConnectionOptions {
    std::string server = kDefaultServer;
    SecurityFiles files;

    // Reads the files; the errors of read_security().
    absl::StatusOr<ClientOptions> open() const;
};

// Adds --server, --tls, --ca, --certificate, --key, --server-name and --token-file, each also from the
// environment (KINEVOX_SERVER, KINEVOX_CA, ...). `options` is filled when the command line is parsed.
void add_connection_options(CLI::App& app, ConnectionOptions& options);

}  // namespace kinevox::client
