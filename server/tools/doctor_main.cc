// kinevox doctor: what is wrong with this machine for a capture, and how to mend it.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <cstdlib>

#include "server/tools/doctor/report.h"

namespace {

using namespace kinevox;
namespace fs = std::filesystem;

constexpr const char* kInstalledConfig = "/etc/kinevox/kinevoxd.toml";
constexpr const char* kInstalledState = "/var/lib/kinevox";

int fail(const std::string& message) {
    fmt::print(stderr, "kinevox doctor: {}\n", message);
    return 1;
}

// Where the daemon keeps its state: the service's, for the service's configuration; else the user's.
fs::path state_folder(const fs::path& config_file) {
    std::error_code error;
    if (config_file == kInstalledConfig || fs::equivalent(config_file, kInstalledConfig, error))
        return kInstalledState;
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state == '/')
        return fs::path(state) / "kinevox";
    if (const char* home = std::getenv("HOME"); home && *home == '/')
        return fs::path(home) / ".local/state/kinevox";
    return {};
}

}  // namespace

int main(int argc, char** argv) {
    std::string config_file;
    bool json = false, script = false, no_discovery = false;
    CLI::App app(
        "What is wrong with this machine for a capture, and how to mend it: cameras, network, USB, GPU "
        "driver, memory, "
        "open files, clock, state, disk and port. Changes nothing. Status 1 where something is bad.",
        "kinevox doctor");
    app.add_option("--config", config_file,
                   fmt::format("The daemon's configuration; without it {}, if it is there", kInstalledConfig))
        ->type_name("FILE");
    app.add_flag("--json", json, "One JSON object");
    app.add_flag("--fix-script", script,
                 "Prints a shell script instead, which mends what root can mend; read it before you run it");
    app.add_flag("--no-discovery", no_discovery, "Does not ask the network for cameras");
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);
        return fail(std::string(error.what()) + "; see kinevox doctor --help");
    }
    std::error_code error;
    if (config_file.empty() && fs::exists(kInstalledConfig, error)) config_file = kInstalledConfig;
    doctor::Facts facts;
    facts.config_file = config_file;
    if (!config_file.empty()) facts.config = read_config(config_file);
    if (!config_file.empty() && absl::IsNotFound(facts.config.status()))
        return fail(std::string(facts.config.status().message()));
    if (!no_discovery) facts.found = discover_cameras();
    facts.state_folder = state_folder(config_file);
    const auto configured = facts.settings().recording.folder;
    if (configured)
        facts.recordings = *configured;
    else if (!facts.state_folder.empty())
        facts.recordings = facts.state_folder / "recordings";

    const doctor::Findings findings = doctor::check_all(facts);
    if (script)
        fmt::print("{}", fix_script(findings));
    else if (json)
        fmt::print("{}\n", to_json(findings));
    else
        fmt::print("{}", to_text(findings, isatty(STDOUT_FILENO)));
    return any_bad(findings) ? 1 : 0;
}
