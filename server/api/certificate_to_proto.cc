#include <nlohmann/json.hpp>

#include "server/api/to_proto.h"
#include "server/calibration/exact_integer.h"

namespace kinevox {
namespace {

using Json = nlohmann::ordered_json;

// Null if there is no such member.
const Json& member(const Json& object, const char* name) {
    static const Json kNothing;
    if (!object.is_object()) return kNothing;
    const auto found = object.find(name);
    return found == object.end() ? kNothing : *found;
}

std::string text(const Json& object, const char* name) {
    const Json& value = member(object, name);
    return value.is_string() ? value.get<std::string>() : "";
}

// Calls `set` if the member is a number.
template <typename Set>
void number(const Json& object, const char* name, const Set& set) {
    if (const Json& value = member(object, name); value.is_number()) set(value.get<double>());
}

v1::Verdict verdict(const std::string& text) {
    if (text == "GO") return v1::VERDICT_GO;
    if (text == "CAUTION") return v1::VERDICT_CAUTION;
    return text == "NO-GO" ? v1::VERDICT_NO_GO : v1::VERDICT_UNSPECIFIED;
}

}  // namespace

v1::CalibrationMethod calibration_method_to_proto(std::string_view name) {
    if (name == "intrinsics_board") return v1::CALIBRATION_METHOD_INTRINSICS_BOARD;
    if (name == "extrinsics_board") return v1::CALIBRATION_METHOD_EXTRINSICS_BOARD;
    if (name == "extrinsics_wand") return v1::CALIBRATION_METHOD_EXTRINSICS_WAND;
    if (name == "person") return v1::CALIBRATION_METHOD_PERSON;
    if (name == "import") return v1::CALIBRATION_METHOD_IMPORT;
    return v1::CALIBRATION_METHOD_UNSPECIFIED;
}

v1::Certificate certificate_to_proto(const std::string& certificate_json) {
    const Json json = Json::parse(certificate_json, nullptr, false);
    v1::Certificate out;
    out.set_verdict(verdict(text(json, "verdict")));
    out.set_method(calibration_method_to_proto(text(json, "method")));
    for (const Json& finding : member(json, "findings")) {
        v1::CertificateFinding& to = *out.add_findings();
        to.set_verdict(verdict(text(finding, "verdict")));
        to.set_check(text(finding, "check"));
        to.set_camera(text(finding, "camera"));
        to.set_reason(text(finding, "reason"));
        to.set_remedy(text(finding, "remedy"));
    }
    number(json, "fit_reprojection_rms_px", [&](double value) { out.set_fit_reprojection_rms_px(value); });
    number(json, "held_out_reprojection_rms_px",
           [&](double value) { out.set_held_out_reprojection_rms_px(value); });
    const Json& scale = member(json, "scale_error_mm_per_m");
    number(scale, "bias", [&](double value) { out.set_scale_bias_mm_per_m(value); });
    number(scale, "spread", [&](double value) { out.set_scale_spread_mm_per_m(value); });
    const Json& hull = member(json, "hull_iou");
    number(hull, "mean_iou", [&](double value) { out.set_hull_iou(value); });
    number(member(json, "hull_iou_before"), "mean_iou",
           [&](double value) { out.set_hull_iou_before(value); });
    number(json, "stature_m", [&](double value) { out.set_stature_m(value); });
    if (const Json& defined = member(json, "world_defined"); defined.is_boolean())
        out.set_world_defined(defined.get<bool>());
    const Json& volume = member(json, "volume");
    number(volume, "two_view_fraction", [&](double value) { out.set_two_view_volume_fraction(value); });
    number(volume, "three_view_fraction", [&](double value) { out.set_three_view_volume_fraction(value); });
    const Json& cameras = member(json, "cameras");
    if (!cameras.is_object()) return out;
    for (const auto& [name, camera] : cameras.items()) {
        v1::CameraCertificate& to = *out.add_cameras();
        to.set_name(name);
        if (const Json& centre = member(camera, "centre_m"); centre.is_array() && centre.size() == 3 &&
                                                             centre[0].is_number() && centre[1].is_number() &&
                                                             centre[2].is_number()) {
            to.mutable_centre_in_world()->set_x(centre[0].get<double>());
            to.mutable_centre_in_world()->set_y(centre[1].get<double>());
            to.mutable_centre_in_world()->set_z(centre[2].get<double>());
        }
        if (const auto views = exact_integer<int>(member(camera, "views"))) to.set_view_count(*views);
        number(camera, "fit_reprojection_rms_px",
               [&](double value) { to.set_fit_reprojection_rms_px(value); });
        number(camera, "held_out_reprojection_rms_px",
               [&](double value) { to.set_held_out_reprojection_rms_px(value); });
        number(camera, "coverage", [&](double value) { to.set_coverage(value); });
        number(member(camera, "intrinsics"), "rms_px",
               [&](double value) { to.set_intrinsics_rms_px(value); });
        number(member(hull, "cameras"), name.c_str(), [&](double value) { to.set_hull_iou(value); });
    }
    return out;
}

}  // namespace kinevox
