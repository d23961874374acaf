#include "client/lib/client_program.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <thread>

namespace kinevox::client {

absl::StatusOr<ClientOptions> ConnectionOptions::open() const {
    ClientOptions out;
    out.server = server;
    auto security = read_security(files, server);
    if (!security.ok()) return security.status();
    out.security = *std::move(security);
    return out;
}

void add_connection_options(CLI::App& app, ConnectionOptions& options) {
    app.fallthrough();
    const auto add = [](CLI::Option* option, const char* variable) {
        return option->envname(variable)->group(kGlobalOptionsGroup);
    };
    SecurityFiles& files = options.files;
    add(app.add_option("--server", options.server, "Address of the daemon, HOST:PORT"), "KINEVOX_SERVER")
        ->capture_default_str();
    add(app.add_flag("--tls", files.tls, "Use TLS (implied by --ca, --certificate, --key, --server-name)"),
        "KINEVOX_TLS");
    add(app.add_option("--ca", files.ca,
                       "CA certificate that signed the daemon's (PEM; default: system CAs)"),
        "KINEVOX_CA");
    add(app.add_option("--certificate", files.certificate, "Client certificate (PEM)"),
        "KINEVOX_CERTIFICATE");
    add(app.add_option("--key", files.key, "Client key (PEM)"), "KINEVOX_KEY");
    add(app.add_option("--server-name", files.server_name,
                       "Expected name in the daemon's certificate (default: HOST)"),
        "KINEVOX_SERVER_NAME");
    add(app.add_option("--token-file", files.token, "File that contains the access token"),
        "KINEVOX_TOKEN_FILE");
}

std::stop_token stop_on_signals() {
    static const std::stop_token token = [] {
        sigset_t signals;
        sigemptyset(&signals);
        sigaddset(&signals, SIGINT);
        sigaddset(&signals, SIGTERM);
        pthread_sigmask(SIG_BLOCK, &signals, nullptr);
        std::stop_source source;
        std::thread([signals, source]() mutable {
            int signal = 0;
            sigwait(&signals, &signal);
            source.request_stop();
            sigwait(&signals, &signal);  // a second signal ends the program at once
            _exit(1);
        }).detach();
        return source.get_token();
    }();
    return token;
}

}  // namespace kinevox::client
