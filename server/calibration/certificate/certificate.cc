#include "server/calibration/certificate/certificate.h"

#include <absl/strings/escaping.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

extern char** environ;

namespace kinevox {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}
Json number(const std::optional<double>& value) {
    return value ? number(*value) : Json(nullptr);
}
Json rounded(double value, double steps) {
    return number(std::round(value * steps) / steps);
}
Json tenth(double value) {
    return rounded(value, 10);
}
Json thousandth(double value) {
    return rounded(value, 1000);
}
Json point(Vec3 p) {
    return Json::array({p.x, p.y, p.z});
}

Json intrinsics_json(const IntrinsicsResult& result) {
    Json out;
    out["rms_px"] = number(result.rms_px);
    out["coverage_counts"] = result.coverage_counts;
    out["held_out_rms_px"] = number(result.held_out_rms_px);
    out["views_used"] = result.used;
    out["coverage"] = number(result.coverage);
    static constexpr const char* kNames[] = {"fx_px", "fy_px", "cx_px", "cy_px", "k1",
                                             "k2",    "p1",    "p2",    "k3"};
    const Camera& c = result.camera;
    const double values[] = {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3};
    for (int i = 0; i < 9; ++i)
        out["parameters"][kNames[i]] = {{"value", number(values[i])}, {"std", number(result.stds[i])}};
    for (const IntrinsicsView& view : result.views) {
        Json one{
            {"frame", view.frame}, {"used", view.use == ViewUse::kUsed}, {"tilt_deg", number(view.tilt_deg)}};
        if (view.rms_px > 0) one["rms_px"] = number(view.rms_px);
        if (!view.reason.empty()) one["reason"] = view.reason;
        out["views"].push_back(one);
    }
    return out;
}

Json hull_json(const HullIou& hull, const std::vector<Camera>& cameras) {
    Json out{{"mean_iou", number(hull.mean_iou)}, {"frames", hull.frames}};
    for (std::size_t c = 0; c < cameras.size() && c < hull.iou.size(); ++c)
        out["cameras"][cameras[c].name] = number(hull.iou[c]);
    return out;
}

namespace fs = std::filesystem;

fs::path report_program() {
    std::error_code error;
    const fs::path here = fs::read_symlink("/proc/self/exe", error).parent_path();
    if (error) return {};
    // Installed, in the build folder, in its tests.
    for (const char* folder : {".", "../lib/kinevox", "../tools", "../../server/tools"})
        if (const fs::path file = here / folder / "kinevox-report"; access(file.c_str(), X_OK) == 0)
            return file.lexically_normal();
    return {};
}

}  // namespace

std::string certificate_json(const Certificate& certificate) {
    Json out;
    out["verdict"] = to_text(certificate.verdict());
    out["method"] = certificate.method;
    if (!certificate.create_time.empty()) out["create_time"] = certificate.create_time;
    out["findings"] = Json::array();
    for (const Finding& finding : certificate.findings) {
        Json one{{"verdict", to_text(finding.verdict)}, {"check", finding.check}};
        if (!finding.camera.empty()) one["camera"] = finding.camera;
        one["reason"] = finding.reason;
        if (!finding.remedy.empty()) one["remedy"] = finding.remedy;
        out["findings"].push_back(one);
    }
    out["fit_reprojection_rms_px"] = number(certificate.fit_rms_px);
    out["held_out_reprojection_rms_px"] = number(certificate.held_out_rms_px);
    if (certificate.scale)
        out["scale_error_mm_per_m"] = {{"bias", number(certificate.scale->bias_mm_per_m)},
                                       {"spread", number(certificate.scale->spread_mm_per_m)},
                                       {"distances", certificate.scale->distances}};
    if (certificate.volume)
        out["volume"] = {{"lower_m", point(certificate.volume->lower)},
                         {"upper_m", point(certificate.volume->upper)},
                         {"two_view_fraction", number(certificate.volume->two_view_fraction)},
                         {"three_view_fraction", number(certificate.volume->three_view_fraction)},
                         {"calibrated_fraction", number(certificate.volume->calibrated_fraction)}};
    if (certificate.floor)
        out["floor"] = {{"method", certificate.floor->method},
                        {"rms_px", number(certificate.floor->rms_px)},
                        {"flatness_rms_mm", number(certificate.floor->flatness_rms_mm)},
                        {"tilt_std_deg", number(certificate.floor->tilt_std_deg)}};
    if (certificate.hull_iou) out["hull_iou"] = hull_json(*certificate.hull_iou, certificate.cameras);
    if (certificate.hull_iou_before)
        out["hull_iou_before"] = hull_json(*certificate.hull_iou_before, certificate.cameras);
    if (certificate.stature_m) out["stature_m"] = number(*certificate.stature_m);
    out["world_defined"] = certificate.world_defined;
    out["cameras"] = Json::object();
    for (std::size_t c = 0; c < certificate.cameras.size(); ++c) {
        const Camera& camera = certificate.cameras[c];
        const Vec3 rotation = rodrigues_from_rotation(camera.camera_from_world.rotation);
        Json one{
            {"centre_m", point(camera.centre_in_world())},
            {"size_px", {camera.width, camera.height}},
            {"focal_px", {number(camera.fx), number(camera.fy)}},
            {"principal_point_px", {number(camera.cx), number(camera.cy)}},
            {"distortion",
             {number(camera.k1), number(camera.k2), number(camera.p1), number(camera.p2), number(camera.k3)}},
            {"camera_from_world",
             {{"rotation_vector", point(rotation)},
              {"translation_m", point(camera.camera_from_world.translation)}}}};
        if (c < certificate.reprojections.size()) {
            const CameraReprojection& q = certificate.reprojections[c];
            one["views"] = q.views;
            one["fit_reprojection_rms_px"] = number(q.fit_rms_px);
            one["held_out_reprojection_rms_px"] = number(q.held_out_rms_px);
            one["coverage"] = number(q.coverage);
            one["coverage_counts"] = q.coverage_counts;
            one["residuals_px"] = Json::array();  // position, residual
            for (const PixelResidual& residual : q.residuals)
                one["residuals_px"].push_back({tenth(residual.pixel.x), tenth(residual.pixel.y),
                                               thousandth(residual.residual_px.x),
                                               thousandth(residual.residual_px.y)});
        }
        for (const IntrinsicsResult& result : certificate.intrinsics)
            if (result.camera.name == camera.name) one["intrinsics"] = intrinsics_json(result);
        out["cameras"][camera.name] = one;
    }
    // Drawn by the page; last because they are long.
    out["target_points_m"] = Json::array();
    for (const Vec3 p : certificate.target_points)
        out["target_points_m"].push_back({thousandth(p.x), thousandth(p.y), thousandth(p.z)});
    for (const SilhouetteOverlay& image : certificate.overlays)
        out["overlay_images"][image.camera] = absl::Base64Escape(image.png);
    return out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::vector<Vec3> sample_points(const std::vector<Vec3>& points) {
    constexpr std::size_t kMaxPoints = 600;
    std::vector<Vec3> some;
    const std::size_t used = std::min(kMaxPoints, points.size());
    for (std::size_t i = 0; i < used; ++i) some.push_back(points[i * points.size() / used]);
    return some;
}

std::string certificate_text(const Certificate& certificate) {
    std::string text = fmt::format("{}\n", to_text(certificate.verdict()));
    for (const Finding& finding : certificate.findings) {
        if (finding.verdict == Verdict::kGo) continue;
        text += fmt::format("  {}: {}{}{}{}\n", to_text(finding.verdict),
                            finding.camera.empty() || finding.reason.find(finding.camera) != std::string::npos
                                ? ""
                                : "camera " + finding.camera + ": ",
                            finding.reason, finding.remedy.empty() ? "" : "; ", finding.remedy);
    }
    return text;
}

absl::Status draw_report_page(const fs::path& json_file, const fs::path& png_file) {
    const std::string program = report_program().string();
    if (program.empty())
        return absl::NotFoundError(
            "the page was not drawn: kinevox-report is not installed next to this program");
    const std::string json = json_file.string(), png = png_file.string();
    std::string words[] = {program, json, "--out", png, "--overwrite"};
    char* arguments[] = {words[0].data(), words[1].data(), words[2].data(),
                         words[3].data(), words[4].data(), nullptr};
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    pid_t child = 0;
    const int started = posix_spawn(&child, program.c_str(), &actions, nullptr, arguments, environ);
    posix_spawn_file_actions_destroy(&actions);
    int status = -1;
    if (started == 0)
        while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
    if (started != 0 || !WIFEXITED(status) || WEXITSTATUS(status) != 0)
        return absl::UnavailableError(
            fmt::format("the page was not drawn; kinevox report {} reports the reason", json));
    return absl::OkStatus();
}

}  // namespace kinevox
