#include "client/cli/verbs.h"

#include <fmt/format.h>
#include <pwd.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "common/command_line.h"

namespace kinevox::cli {
namespace {

std::string global_options_help(const CLI::App& app) {
    const auto options = app.get_options(
        [](const CLI::Option* option) { return option->get_group() == client::kGlobalOptionsGroup; });
    return CLI::Formatter().make_group(client::kGlobalOptionsGroup, false, options);
}

}  // namespace

client::ClientOptions GlobalOptions::client_options() const {
    client::ClientOptions options = opened_;
    options.timeout = std::chrono::milliseconds(static_cast<std::int64_t>(timeout_s * 1000));
    return options;
}

absl::Status GlobalOptions::open() {
    auto options = connection.open();
    if (options.ok()) opened_ = *std::move(options);
    return options.status();
}

void add_global_options(CLI::App& app, GlobalOptions& global) {
    client::add_connection_options(app, global.connection);
    app.add_option("--timeout", global.timeout_s, "Timeout of a call (s)")
        ->envname("KINEVOX_TIMEOUT")
        ->check(CLI::Range(0.001, 86400.0))
        ->capture_default_str()
        ->group(client::kGlobalOptionsGroup);
    app.add_flag("--json", global.json, "Print JSON")->group(client::kGlobalOptionsGroup);
}

void show_global_options_in_help(CLI::App& app) {
    const std::function<void(CLI::App&)> add = [&](CLI::App& parent) {
        for (CLI::App* sub : parent.get_subcommands([](CLI::App*) { return true; })) {
            sub->footer([&app] { return global_options_help(app) + "\n" + kExitStatusHelp; });
            add(*sub);
        }
    };
    add(app);
}

void add_operator_option(CLI::App& command, std::string& operator_name) {
    command.add_option("--operator", operator_name, "Operator name shown to other clients")
        ->capture_default_str();
}

std::string default_operator_name() {
    char host[256] = "host";
    gethostname(host, sizeof host - 1);
    const passwd* user = getpwuid(getuid());
    return std::string(user ? user->pw_name : "unknown") + "@" + host;
}

void add_yes_option(CLI::App& command, bool& yes) {
    command.add_flag("--yes", yes, "Delete without asking");
}

absl::Status confirm_deletion(bool yes, const std::string& what) {
    if (yes) return absl::OkStatus();
    if (!isatty(STDIN_FILENO) || !isatty(STDERR_FILENO))
        return absl::FailedPreconditionError(
            fmt::format("deleting {} needs a confirmation; give --yes", what));
    fmt::print(stderr, "delete {}? [y/N] ", what);
    std::string answer;
    std::getline(std::cin, answer);
    if (answer == "y" || answer == "Y" || answer == "yes") return absl::OkStatus();
    return absl::CancelledError("nothing was deleted");
}

void add_overwrite_option(CLI::App& command, bool& overwrite) {
    command.add_flag("--overwrite", overwrite, "Replace existing output");
}

absl::Status check_overwrite(bool overwrite, const std::string& file) {
    std::error_code error;
    const auto type = std::filesystem::status(file, error).type();
    const bool exists =
        type == std::filesystem::file_type::regular ||
        (type == std::filesystem::file_type::directory && !std::filesystem::is_empty(file, error));
    if (overwrite || !exists) return absl::OkStatus();
    return absl::AlreadyExistsError(fmt::format("{} exists; give another path, or --overwrite", file));
}

bool print_line(const std::string& line) {
    std::fwrite(line.data(), 1, line.size(), stdout);
    std::fputc('\n', stdout);
    return std::fflush(stdout) == 0;
}

}  // namespace kinevox::cli
