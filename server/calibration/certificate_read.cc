// Certificates back from their JSON.
#include <absl/strings/escaping.h>
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "common/one_line.h"
#include "server/calibration/certificate.h"
#include "server/calibration/coverage.h"
#include "server/calibration/whole_number.h"

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
    for (const Verdict verdict : {Verdict::kGo, Verdict::kCare, Verdict::kNoGo})
        if (text == to_text(verdict)) return verdict;
    throw std::invalid_argument("'" + text.substr(0, 20) + "' is no verdict");
}

int count(const Json& value) {
    if (const auto number = whole_number<int>(value); number.value_or(-1) >= 0) return *number;
    throw std::invalid_argument(value.dump().substr(0, 20) + " is no count");
}

std::vector<int> counts_of(const Json& object) {
    std::vector<int> counts;
    for (const Json& views : object.value("coverage_counts", Json::array())) counts.push_back(count(views));
    if (!counts.empty() && counts.size() != std::size_t{Coverage::kColumns * Coverage::kRows})
        throw std::invalid_argument("coverage_counts has another size");
    return counts;
}

Camera camera_of(const std::string& name, const Json& in) {
    Camera camera;
    camera.name = name;
    if (!camera_name_problem(name).empty())
        throw std::invalid_argument("a camera's name " + camera_name_problem(name));
    camera.width = count(in.at("size_px").at(0)), camera.height = count(in.at("size_px").at(1));
    camera.fx = number(in.at("focal_px").at(0)), camera.fy = number(in.at("focal_px").at(1));
    camera.cx = number(in.at("middle_px").at(0)), camera.cy = number(in.at("middle_px").at(1));
    double* const distortion[] = {&camera.k1, &camera.k2, &camera.p1, &camera.p2, &camera.k3};
    for (int i = 0; i < 5; ++i) *distortion[i] = number(in.at("distortion").at(i));
    const Json& place = in.at("camera_from_world");
    camera.camera_from_world = {rotation_from_rodrigues(point(place.at("rotation_vector"))),
                                point(place.at("translation_m"))};
    return camera;
}

CameraQuality quality_of(const Json& in) {
    CameraQuality quality;
    quality.views = count(in.at("views"));
    quality.fit_rms_px = number(in.at("fit_rms_px"));
    quality.held_out_rms_px = maybe(in, "held_out_rms_px");
    quality.coverage = number(in.at("coverage"));
    quality.coverage_counts = counts_of(in);
    for (const Json& miss : in.value("misses_px", Json::array()))
        quality.misses.push_back(
            {{number(miss.at(0)), number(miss.at(1))}, {number(miss.at(2)), number(miss.at(3))}});
    return quality;
}

IntrinsicsResult lens_of(const Camera& camera, const Json& in) {
    IntrinsicsResult lens;
    lens.camera = camera;
    lens.rms_px = number(in.at("rms_px"));
    lens.held_out_rms_px = maybe(in, "held_out_rms_px");
    lens.used = count(in.at("views_used"));
    lens.coverage = number(in.at("coverage"));
    lens.coverage_counts = counts_of(in);
    static constexpr const char* kNames[] = {"fx_px", "fy_px", "cx_px", "cy_px", "k1",
                                             "k2",    "p1",    "p2",    "k3"};
    for (int i = 0; i < 9; ++i) lens.std_deviations[i] = number(in.at("parameters").at(kNames[i]).at("std"));
    return lens;
}

HullAgreement hull_of(const Json& in, const std::vector<Camera>& cameras) {
    HullAgreement hull;
    hull.mean_iou = number(in.at("mean_iou"));
    hull.frames = count(in.at("frames"));
    for (const Camera& camera : cameras)
        hull.iou.push_back(
            maybe(in.value("cameras", Json::object()), camera.name.c_str()).value_or(std::nan("")));
    return hull;
}

Certificate certificate_of(const Json& in) {
    Certificate out;
    out.made_by = in.at("made_by").get<std::string>();
    out.made_at = in.value("made_at", "");
    for (const Json& finding : in.at("findings"))
        out.findings.push_back({verdict_of(finding.at("verdict").get<std::string>()),
                                finding.at("check").get<std::string>(), finding.value("camera", ""),
                                finding.at("reason").get<std::string>(), finding.value("remedy", "")});
    out.fit_rms_px = number(in.at("fit_rms_px"));
    out.held_out_rms_px = maybe(in, "held_out_rms_px");
    if (const auto scale = in.find("scale_error_mm_per_m"); scale != in.end())
        out.scale =
            ScaleError{number(scale->at("bias")), number(scale->at("spread")), count(scale->at("distances"))};
    if (const auto volume = in.find("volume"); volume != in.end())
        out.volume =
            VolumeCoverage{point(volume->at("lower_m")), point(volume->at("upper_m")),
                           number(volume->at("seen_by_two_cameras")),
                           number(volume->at("seen_by_three_cameras")), number(volume->at("calibrated"))};
    if (const auto floor = in.find("floor"); floor != in.end())
        out.floor = FloorQuality{floor->at("made_by").get<std::string>(), maybe(*floor, "rms_px"),
                                 maybe(*floor, "flat_rms_mm"), maybe(*floor, "tilt_std_deg")};
    out.subject_height_m = maybe(in, "subject_height_m");
    out.world_is_set = in.at("world_is_set").get<bool>();
    for (const auto& [name, section] : in.at("cameras").items()) {
        out.cameras.push_back(camera_of(name, section));
        if (section.contains("views")) out.quality.push_back(quality_of(section));
        if (const auto lens = section.find("lens"); lens != section.end())
            out.lenses.push_back(lens_of(out.cameras.back(), *lens));
    }
    if (!out.quality.empty() && out.quality.size() != out.cameras.size())
        throw std::invalid_argument("some cameras have no views");
    if (const auto hull = in.find("hull_agreement"); hull != in.end()) out.hull = hull_of(*hull, out.cameras);
    if (const auto hull = in.find("hull_agreement_before"); hull != in.end())
        out.hull_before = hull_of(*hull, out.cameras);
    for (const Json& seen : in.value("seen_points_m", Json::array())) out.seen_points.push_back(point(seen));
    const Json pictures = in.value("pictures", Json::object());
    for (const auto& [name, text] : pictures.items()) {
        AgreementPicture picture{name, {}};
        if (!absl::Base64Unescape(text.get<std::string>(), &picture.png))
            throw std::invalid_argument("a picture is broken");
        out.pictures.push_back(std::move(picture));
    }
    return out;
}

}  // namespace

absl::StatusOr<Certificate> parse_certificate(const std::string& json, const std::string& name_for_errors) {
    try {
        return certificate_of(Json::parse(json));
    } catch (const std::exception& error) {  // nlohmann's, too
        return absl::InvalidArgumentError(
            fmt::format("{}: is no certificate of a calibration: {}; calibrate again", name_for_errors,
                        one_line(error.what()).substr(0, 160)));
    }
}

}  // namespace kinevox
