#include "client/cli/verbs.h"

#include <pthread.h>
#include <pwd.h>
#include <signal.h>
#include <unistd.h>

#include <cstdio>
#include <thread>

#include <CLI/CLI.hpp>

namespace kinevox::cli {

client::ClientOptions Common::client_options() const {
    return {server, std::chrono::milliseconds(static_cast<std::int64_t>(timeout_s * 1000))};
}

void add_common_options(CLI::App& verb, Common& common) {
    verb.add_option("--server", common.server, "The daemon's address, HOST:PORT")
        ->envname("KINEVOX_SERVER")
        ->capture_default_str();
    verb.add_option("--timeout", common.timeout_s, "Seconds to wait for the daemon's answer")
        ->check(CLI::Range(0.001, 86400.0))
        ->capture_default_str();
    verb.add_flag("--json", common.json, "JSON on standard output");
}

std::string default_operator_name() {
    char host[256] = "host";
    gethostname(host, sizeof host - 1);
    const passwd* user = getpwuid(getuid());
    return std::string(user ? user->pw_name : "somebody") + "@" + host;
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
            sigwait(&signals, &signal);   // somebody is in a hurry
            _exit(1);
        }).detach();
        return source.get_token();
    }();
    return token;
}

bool print_line(const std::string& line) {
    std::fwrite(line.data(), 1, line.size(), stdout);
    std::fputc('\n', stdout);
    return std::fflush(stdout) == 0;
}

}  // namespace kinevox::cli
