// kinevox discover: cameras on the network and on USB, with the names that the configuration uses.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "common/command_line.h"
#include "common/progress_line.h"
#include "server/cameras/aravis/live_source.h"

namespace {

using namespace kinevox;

nlohmann::ordered_json to_json(const FoundCamera& camera) {
    return {{"serial", camera.serial}, {"name", camera.user_name},   {"vendor", camera.vendor},
            {"model", camera.model},   {"address", camera.address},  {"mac", camera.physical_id},
            {"id", camera.id},         {"protocol", camera.protocol}};
}

// Exit status 1 without a camera; a JSON list is printed in any case.
absl::Status discover(bool json) {
    ProgressLine line(json);
    line.draw("searching for cameras ...");
    const auto found = discover_cameras();
    line.clear();
    if (json) {
        auto list = nlohmann::ordered_json::array();
        for (const FoundCamera& camera : found) list.push_back(to_json(camera));
        fmt::print("{}\n", list.dump());
    }
    if (found.empty())
        return absl::NotFoundError(
            "no camera answers; see docs/cameras.md for cables, addresses and firewalls");
    if (json) return absl::OkStatus();
    fmt::print("{:<16} {:<16} {:<16} {:<18} {:<12} {}\n", "serial", "name", "address", "MAC", "protocol",
               "camera");
    for (const FoundCamera& camera : found)
        fmt::print("{:<16} {:<16} {:<16} {:<18} {:<12} {} {}\n", camera.serial, camera.user_name,
                   camera.address, camera.physical_id, camera.protocol, camera.vendor, camera.model);
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    bool json = false;
    CLI::App app(
        "List cameras on the network and USB (broadcasts on every interface; other subnets are not "
        "searched).",
        "kinevox discover");
    app.footer("Exit status: 0 if a camera answers, else 1.");
    app.add_flag("--json", json, "Print one JSON list");
    return tool_main(app, argc, argv, [&] { return discover(json); });
}
