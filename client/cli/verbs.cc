#include "client/cli/verbs.h"

#include <pwd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>

namespace kinevox::cli {

client::ClientOptions Common::client_options() const {
    client::ClientOptions options = opened_;
    options.timeout = std::chrono::milliseconds(static_cast<std::int64_t>(timeout_s * 1000));
    return options;
}

absl::Status Common::open() {
    auto options = connection.open();
    if (options.ok()) opened_ = *std::move(options);
    return options.status();
}

void add_common_options(CLI::App& verb, Common& common) {
    verb.add_option("--timeout", common.timeout_s, "Seconds to wait for the daemon's answer")
        ->envname("KINEVOX_TIMEOUT")
        ->check(CLI::Range(0.001, 86400.0))
        ->capture_default_str();
    verb.add_flag("--json", common.json, "JSON on standard output");
    client::add_connection_options(verb, common.connection);
}

std::string default_operator_name() {
    char host[256] = "host";
    gethostname(host, sizeof host - 1);
    const passwd* user = getpwuid(getuid());
    return std::string(user ? user->pw_name : "somebody") + "@" + host;
}

bool print_line(const std::string& line) {
    std::fwrite(line.data(), 1, line.size(), stdout);
    std::fputc('\n', stdout);
    return std::fflush(stdout) == 0;
}

}  // namespace kinevox::cli
