// kinevox discover: the cameras on the network and on USB, and how to name them in the configuration.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "server/cameras/aravis/discovery.h"

namespace {

using namespace kinevox;

nlohmann::ordered_json to_json(const FoundCamera& camera) {
    return {{"serial", camera.serial}, {"name", camera.user_name},   {"vendor", camera.vendor},
            {"model", camera.model},   {"address", camera.address},  {"mac", camera.physical_id},
            {"id", camera.id},         {"protocol", camera.protocol}};
}

}  // namespace

int main(int argc, char** argv) {
    bool json = false;
    CLI::App app(
        "The cameras on the network and on USB. Asks on every network interface and waits a second for "
        "answers; "
        "cameras in another subnet do not hear it.",
        "kinevox discover");
    app.add_flag("--json", json, "One JSON list");
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);
        fmt::print(stderr, "kinevox discover: {}; see kinevox discover --help\n", error.what());
        return 1;
    }
    const auto found = discover_cameras();
    if (json) {
        auto list = nlohmann::ordered_json::array();
        for (const FoundCamera& camera : found) list.push_back(to_json(camera));
        fmt::print("{}\n", list.dump());
        return 0;
    }
    if (found.empty()) {
        fmt::print("no camera answers; see docs/cameras.md for cables, addresses and firewalls\n");
        return 0;
    }
    fmt::print("{:<16} {:<16} {:<16} {:<18} {:<12} {}\n", "serial", "name", "address", "MAC", "protocol",
               "camera");
    for (const FoundCamera& camera : found)
        fmt::print("{:<16} {:<16} {:<16} {:<18} {:<12} {} {}\n", camera.serial, camera.user_name,
                   camera.address, camera.physical_id, camera.protocol, camera.vendor, camera.model);
    return 0;
}
