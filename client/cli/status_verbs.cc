#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <cmath>

#include "client/cli/json.h"
#include "client/cli/status_text.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

absl::Status run_status(const Common& common) {
    const auto status = client::Client(common.client_options()).status();
    if (!status.ok()) return status.status();
    print_line(common.json ? to_json(*status).dump() : status_text(*status));
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

absl::Status run_cameras(const Common& common) {
    const auto cameras = client::Client(common.client_options()).cameras();
    if (!cameras.ok()) return cameras.status();
    if (common.json) {
        nlohmann::ordered_json list = nlohmann::ordered_json::array();
        for (const Camera& camera : *cameras) list.push_back(camera_json(camera));
        print_line(list.dump());
        return absl::OkStatus();
    }
    print_line(fmt::format("{:<12} {:>11} {:>9} {:>9}   {}", "camera", "picture px", "fx px", "view deg",
                           "centre in the world, m"));
    for (const Camera& camera : *cameras) {
        const Vec3 centre = camera.centre_in_world();
        const double view_deg = 2 * std::atan(0.5 * camera.width / camera.fx) * 180 / M_PI;
        print_line(fmt::format("{:<12} {:>11} {:>9.1f} {:>9.1f}   {:.3f} {:.3f} {:.3f}", camera.name,
                               fmt::format("{}x{}", camera.width, camera.height), camera.fx, view_deg,
                               centre.x, centre.y, centre.z));
    }
    return absl::OkStatus();
}

}  // namespace

void add_status_verbs(CLI::App& app, Common& common, Run& run) {
    CLI::App* status = app.add_subcommand("status", "State, rates, stage times and the subject, once");
    add_common_options(*status, common);
    status->callback([&] { run = [&common] { return run_status(common); }; });
    CLI::App* cameras = app.add_subcommand("cameras", "The cameras and their calibration");
    add_common_options(*cameras, common);
    cameras->callback([&] { run = [&common] { return run_cameras(common); }; });
}

}  // namespace kinevox::cli
