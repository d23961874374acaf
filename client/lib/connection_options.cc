#include "client/lib/connection_options.h"

#include <CLI/CLI.hpp>

namespace kinevox::client {

absl::StatusOr<ClientOptions> ConnectionOptions::open() const {
    ClientOptions out{.server = server};
    auto security = read_security(files, server);
    if (!security.ok()) return security.status();
    out.security = *std::move(security);
    return out;
}

void add_connection_options(CLI::App& app, ConnectionOptions& options) {
    app.add_option("--server", options.server, "The daemon's address, HOST:PORT")
        ->envname("KINEVOX_SERVER")
        ->capture_default_str();
    SecurityFiles& files = options.files;
    app.add_flag("--tls", files.tls, "Speak TLS; any of the next four says so, too")->envname("KINEVOX_TLS");
    app.add_option("--ca", files.ca,
                   "PEM file: who signed the daemon's certificate; else this machine's authorities")
        ->envname("KINEVOX_CA");
    app.add_option("--certificate", files.certificate, "PEM file: one's own certificate")
        ->envname("KINEVOX_CERTIFICATE");
    app.add_option("--key", files.key, "PEM file: its key")->envname("KINEVOX_KEY");
    app.add_option("--server-name", files.server_name,
                   "The name in the daemon's certificate where it is not HOST")
        ->envname("KINEVOX_SERVER_NAME");
    app.add_option("--token-file", files.token, "File with the token that the daemon's administrator gave")
        ->envname("KINEVOX_TOKEN_FILE");
}

}  // namespace kinevox::client
