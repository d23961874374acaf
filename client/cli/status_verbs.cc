// `kinevox status` and `kinevox cameras`.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>

#include "client/cli/output.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct NoOptions {};

absl::Status run_status(const GlobalOptions& global, const NoOptions&) {
    const auto status = client::Client(global.client_options()).status();
    if (!status.ok()) return status.status();
    print_line(global.json ? to_json(*status).dump() : status_text(*status));
    return absl::OkStatus();
}

nlohmann::ordered_json camera_json(const Camera& camera) {
    const Vec3 centre = camera.centre_in_world();
    const Vec3& t = camera.camera_from_world.translation;
    return {{"name", camera.name},
            {"width_px", camera.width},
            {"height_px", camera.height},
            {"fx_px", camera.fx},
            {"fy_px", camera.fy},
            {"cx_px", camera.cx},
            {"cy_px", camera.cy},
            {"distortion", {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3}},
            {"rotation_camera_from_world", camera.camera_from_world.rotation.m},
            {"translation_camera_from_world_m", {t.x, t.y, t.z}},
            {"centre_in_world_m", {centre.x, centre.y, centre.z}}};
}

absl::Status run_cameras(const GlobalOptions& global, const NoOptions&) {
    const auto cameras = client::Client(global.client_options()).cameras();
    if (!cameras.ok()) return cameras.status();
    if (global.json) {
        nlohmann::ordered_json list = nlohmann::ordered_json::array();
        for (const Camera& camera : *cameras) list.push_back(camera_json(camera));
        print_line(list.dump());
        return absl::OkStatus();
    }
    Table table({"camera", ">image px", ">fx px", ">view deg", ">x m", ">y m", ">z m"});
    for (const Camera& camera : *cameras) {
        const Vec3 centre = camera.centre_in_world();
        const double view_deg = 2 * std::atan(0.5 * camera.width / camera.fx) * 180 / M_PI;
        table.add({camera.name, fmt::format("{}x{}", camera.width, camera.height),
                   fmt::format("{:.1f}", camera.fx), fmt::format("{:.1f}", view_deg),
                   fmt::format("{:.3f}", centre.x), fmt::format("{:.3f}", centre.y),
                   fmt::format("{:.3f}", centre.z)});
    }
    print_line(table.text());
    return absl::OkStatus();
}

}  // namespace

void add_status_verbs(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto none = std::make_shared<NoOptions>();
    add_action(app, global, run, none, "status", "Show state, rates, stage times and subjects", run_status);
    add_action(app, global, run, none, "cameras", "List cameras and their calibration", run_cameras);
}

}  // namespace kinevox::cli
