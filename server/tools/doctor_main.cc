// kinevox doctor: checks this machine for capture problems and suggests fixes.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>

#include "common/command_line.h"
#include "common/progress_line.h"
#include "server/tools/doctor/checks.h"

namespace {

using namespace kinevox;
namespace fs = std::filesystem;

constexpr const char* kInstalledConfig = "/etc/kinevox/kinevoxd.toml";
constexpr const char* kInstalledState = "/var/lib/kinevox";

// The daemon's state folder: the service's for the service's configuration, else the user's.
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

struct Arguments {
    std::string config_file;
    bool json = false, script = false, no_discovery = false;
};

absl::Status examine(Arguments arguments) {
    std::error_code error;
    if (arguments.config_file.empty() && fs::exists(kInstalledConfig, error))
        arguments.config_file = kInstalledConfig;
    doctor::Facts facts;
    facts.config_file = arguments.config_file;
    if (!arguments.config_file.empty()) facts.config = read_config(arguments.config_file);
    if (!arguments.config_file.empty() && absl::IsNotFound(facts.config.status()))
        return facts.config.status();
    ProgressLine line(arguments.json);
    line.draw("checking the machine ...");
    if (!arguments.no_discovery) facts.found = discover_cameras();
    facts.state_folder = state_folder(arguments.config_file);
    const auto configured = facts.settings().recording.folder;
    if (configured)
        facts.recordings = *configured;
    else if (!facts.state_folder.empty())
        facts.recordings = facts.state_folder / "recordings";

    const doctor::Findings findings = doctor::check_all(facts);
    line.clear();
    if (arguments.script)
        fmt::print("{}", fix_script(findings));
    else if (arguments.json)
        fmt::print("{}\n", to_json(findings));
    else
        fmt::print("{}", to_text(findings, isatty(STDOUT_FILENO)));
    // The findings are the message.
    return any_error(findings) ? absl::FailedPreconditionError("") : absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    Arguments arguments;
    CLI::App app(
        "Check this machine for capture problems and suggest fixes: cameras, network, USB, GPU driver, "
        "memory, open "
        "files, clock, state, disk and port. Changes nothing.",
        "kinevox doctor");
    app.footer("Exit status: 0 without an ERROR, else 1.");
    app.add_option("--config", arguments.config_file,
                   fmt::format("Configuration of the daemon (default: {}, if it exists)", kInstalledConfig))
        ->type_name("FILE");
    app.add_flag("--json", arguments.json, "Print one JSON object");
    app.add_flag("--fix-script", arguments.script,
                 "Print a shell script of the fixes (review before running)");
    app.add_flag("--no-discovery", arguments.no_discovery, "Do not search the network for cameras");
    return tool_main(app, argc, argv, [&] { return examine(arguments); });
}
