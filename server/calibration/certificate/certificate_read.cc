// Parses certificates.
#include <absl/strings/escaping.h>
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/one_line.h"
#include "server/calibration/certificate/certificate.h"
#include "server/calibration/coverage.h"
#include "server/calibration/exact_integer.h"

namespace kinevox {
namespace {

using Json = nlohmann::ordered_json;

double number(const Json& value) {
    return value.is_null() ? std::nan("") : value.get<double>();
}
std::optional<double> maybe(const Json& object, const char* key) {
    const auto found = object.find(key);
    return found == object.end() || found->is_null() ? std::nullopt : std::optional(found->get<double>());
}
Vec3 point(const Json& value) {
    return {number(value.at(0)), number(value.at(1)), number(value.at(2))};
}

Verdict verdict_of(const std::string& text) {
    for (const Verdict verdict : {Verdict::kGo, Verdict::kCaution, Verdict::kNoGo})
        if (text == to_text(verdict)) return verdict;
    throw std::invalid_argument("'" + text.substr(0, 20) + "' is not a verdict");
}

int count(const Json& value) {
    if (const auto number = exact_integer<int>(value); number.value_or(-1) >= 0) return *number;
    throw std::invalid_argument(value.dump().substr(0, 20) + " is not a count");
}

std::vector<int> counts_of(const Json& object) {
    std::vector<int> counts;
    for (const Json& views : object.value("coverage_counts", Json::array())) counts.push_back(count(views));
    if (!counts.empty() && counts.size() != std::size_t{Coverage::kColumns * Coverage::kRows})
        throw std::invalid_argument("coverage_counts has the wrong size");
    return counts;
}

Camera camera_of(const std::string& name, const Json& in) {
    Camera camera;
    camera.name = name;
    if (!camera_name_problem(name).empty())
        throw std::invalid_argument("a camera's name " + camera_name_problem(name));
    camera.width = count(in.at("size_px").at(0)), camera.height = count(in.at("size_px").at(1));
    camera.fx = number(in.at("focal_px").at(0)), camera.fy = number(in.at("focal_px").at(1));
    camera.cx = number(in.at("principal_point_px").at(0)),
    camera.cy = number(in.at("principal_point_px").at(1));
    double* const distortion[] = {&camera.k1, &camera.k2, &camera.p1, &camera.p2, &camera.k3};
    for (int i = 0; i < 5; ++i) *distortion[i] = number(in.at("distortion").at(i));
    const Json& pose = in.at("camera_from_world");
    camera.camera_from_world = {rotation_from_rodrigues(point(pose.at("rotation_vector"))),
                                point(pose.at("translation_m"))};
    return camera;
}

CameraReprojection quality_of(const Json& in) {
    CameraReprojection quality;
    quality.views = count(in.at("views"));
    quality.fit_rms_px = number(in.at("fit_reprojection_rms_px"));
    quality.held_out_rms_px = maybe(in, "held_out_reprojection_rms_px");
    quality.coverage = number(in.at("coverage"));
    quality.coverage_counts = counts_of(in);
    for (const Json& residual : in.value("residuals_px", Json::array()))
        quality.residuals.push_back({{number(residual.at(0)), number(residual.at(1))},
                                     {number(residual.at(2)), number(residual.at(3))}});
    return quality;
}

IntrinsicsResult intrinsics_of(const Camera& camera, const Json& in) {
    IntrinsicsResult intrinsics;
    intrinsics.camera = camera;
    intrinsics.rms_px = number(in.at("rms_px"));
    intrinsics.held_out_rms_px = maybe(in, "held_out_rms_px");
    intrinsics.used = count(in.at("views_used"));
    intrinsics.coverage = number(in.at("coverage"));
    intrinsics.coverage_counts = counts_of(in);
    static constexpr const char* kNames[] = {"fx_px", "fy_px", "cx_px", "cy_px", "k1",
                                             "k2",    "p1",    "p2",    "k3"};
    for (int i = 0; i < 9; ++i) intrinsics.stds[i] = number(in.at("parameters").at(kNames[i]).at("std"));
    return intrinsics;
}

HullIou hull_of(const Json& in, const std::vector<Camera>& cameras) {
    HullIou hull;
    hull.mean_iou = number(in.at("mean_iou"));
    hull.frames = count(in.at("frames"));
    for (const Camera& camera : cameras)
        hull.iou.push_back(
            maybe(in.value("cameras", Json::object()), camera.name.c_str()).value_or(std::nan("")));
    return hull;
}

// Keys of certificates before version 1.
constexpr std::pair<const char*, const char*> kRenamedKeys[] = {
    {"made_by", "method"},
    {"made_at", "create_time"},
    {"fit_rms_px", "fit_reprojection_rms_px"},
    {"held_out_rms_px", "held_out_reprojection_rms_px"},
    {"hull_agreement", "hull_iou"},
    {"hull_agreement_before", "hull_iou_before"},
    {"seen_points_m", "target_points_m"},
    {"pictures", "overlay_images"},
    {"subject_height_m", "stature_m"},
    {"world_is_set", "world_defined"},
};

Certificate certificate_of(const Json& in) {
    for (const auto& [old_key, new_key] : kRenamedKeys)
        if (in.contains(old_key))
            throw std::invalid_argument(fmt::format("key '{}' is now '{}'", old_key, new_key));
    Certificate out;
    out.method = in.at("method").get<std::string>();
    out.create_time = in.value("create_time", "");
    for (const Json& finding : in.at("findings"))
        out.findings.push_back({verdict_of(finding.at("verdict").get<std::string>()),
                                finding.at("check").get<std::string>(), finding.value("camera", ""),
                                finding.at("reason").get<std::string>(), finding.value("remedy", "")});
    out.fit_rms_px = number(in.at("fit_reprojection_rms_px"));
    out.held_out_rms_px = maybe(in, "held_out_reprojection_rms_px");
    if (const auto scale = in.find("scale_error_mm_per_m"); scale != in.end())
        out.scale =
            ScaleError{number(scale->at("bias")), number(scale->at("spread")), count(scale->at("distances"))};
    if (const auto volume = in.find("volume"); volume != in.end())
        out.volume =
            VolumeCoverage{point(volume->at("lower_m")), point(volume->at("upper_m")),
                           number(volume->at("two_view_fraction")), number(volume->at("three_view_fraction")),
                           number(volume->at("calibrated_fraction"))};
    if (const auto floor = in.find("floor"); floor != in.end())
        out.floor = FloorQuality{floor->at("method").get<std::string>(), maybe(*floor, "rms_px"),
                                 maybe(*floor, "flatness_rms_mm"), maybe(*floor, "tilt_std_deg")};
    out.stature_m = maybe(in, "stature_m");
    out.world_defined = in.at("world_defined").get<bool>();
    for (const auto& [name, section] : in.at("cameras").items()) {
        out.cameras.push_back(camera_of(name, section));
        if (section.contains("views")) out.reprojections.push_back(quality_of(section));
        if (const auto intrinsics = section.find("intrinsics"); intrinsics != section.end())
            out.intrinsics.push_back(intrinsics_of(out.cameras.back(), *intrinsics));
    }
    if (!out.reprojections.empty() && out.reprojections.size() != out.cameras.size())
        throw std::invalid_argument("some cameras have no views");
    if (const auto hull = in.find("hull_iou"); hull != in.end()) out.hull_iou = hull_of(*hull, out.cameras);
    if (const auto hull = in.find("hull_iou_before"); hull != in.end())
        out.hull_iou_before = hull_of(*hull, out.cameras);
    for (const Json& seen : in.value("target_points_m", Json::array()))
        out.target_points.push_back(point(seen));
    const Json images = in.value("overlay_images", Json::object());
    for (const auto& [name, text] : images.items()) {
        SilhouetteOverlay image{name, {}};
        if (!absl::Base64Unescape(text.get<std::string>(), &image.png))
            throw std::invalid_argument("an overlay image is damaged");
        out.overlays.push_back(std::move(image));
    }
    return out;
}

}  // namespace

absl::StatusOr<Certificate> parse_certificate(const std::string& json, const std::string& name_for_errors) {
    try {
        return certificate_of(Json::parse(json));
    } catch (const std::exception& error) {  // including nlohmann's
        return absl::InvalidArgumentError(
            fmt::format("{}: not a calibration certificate: {}; calibrate again", name_for_errors,
                        one_line(error.what()).substr(0, 160)));
    }
}

}  // namespace kinevox
