#include "server/quality/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>

namespace kinevox::quality {
namespace {

using Json = nlohmann::ordered_json;

Json number(double value) {
    return std::isfinite(value) ? Json(std::round(value * 1e4) / 1e4) : Json(nullptr);
}
Json number(const std::optional<double>& value) {
    return value ? number(*value) : Json(nullptr);
}

Json json_of(const Cause& cause) {
    Json out = {{"cause", cause.cause}, {"trust", to_text(cause.trust)}};
    if (!cause.camera.empty()) out["camera"] = cause.camera;
    out["reason"] = cause.reason;
    out["remedy"] = cause.remedy;
    return out;
}

Json json_of(const CameraMeasurements& camera) {
    return {{"name", camera.name},
            {"posed_iou", number(camera.posed_iou)},
            {"hull_iou", number(camera.hull_iou)},
            {"seen_fraction", number(camera.seen_fraction)},
            {"truncated_fraction", number(camera.truncated_fraction)},
            {"mean_level", number(camera.mean_level)},
            {"dark_fraction", number(camera.dark_fraction)},
            {"saturated_fraction", number(camera.saturated_fraction)},
            {"foreground_fraction", number(camera.foreground_fraction)},
            {"still_area_ratio", number(camera.still_area_ratio)},
            {"still_in_background_fraction", number(camera.still_in_background_fraction)},
            {"ghost_contour_fraction", number(camera.ghost_contour_fraction)}};
}

Json json_of(const Measurements& seen) {
    const PoseMeasurements& pose = seen.pose;
    Json out = {{"frame_sets", seen.frame_sets},
                {"posed_iou", number(pose.posed_iou)},
                {"hull_iou", number(seen.rig.hull_iou)},
                {"min_hull_iou", number(seen.rig.min_hull_iou)},
                {"low_hull_iou", number(seen.rig.low_hull_iou)},
                {"silhouette_residual_px", number(seen.rig.residual_px)},
                {"contour_residual_m", number(pose.contour_residual_m)},
                {"joint_std_m", number(pose.joint_std_m)},
                {"lowest_joint_m", number(pose.lowest_m)},
                {"withheld_fraction", number(pose.withheld_fraction)},
                {"subject_fraction", number(pose.subject_fraction)},
                {"posed_fraction", number(pose.posed_fraction)},
                {"several_people_fraction", number(seen.several_people_fraction)},
                {"merged_people_fraction", number(seen.merged_people_fraction)},
                {"followed_subjects", seen.followed_subjects},
                {"stature_m", number(seen.body.stature_m)},
                {"fitted_stature_m", number(seen.body.fitted_stature_m)},
                {"feet_unseen", seen.body.feet_unseen},
                {"subject_height_m", number(seen.world.subject_height_m)},
                {"max_height_m", number(seen.world.max_height_m)},
                {"volume_litres", number(seen.world.volume_litres)},
                {"tilt_deg", number(seen.world.tilt_deg)},
                {"subject_tilt_deg", number(seen.world.subject_tilt_deg)},
                {"lowest_m", number(seen.world.lowest_m)}};
    if (seen.followed_subjects > 1) out["subject"] = seen.subject_id;
    if (!seen.subject_name.empty()) out["subject_name"] = seen.subject_name;
    Json hypotheses = Json::object();
    const auto add = [&](const char* kind, const std::optional<RigHypothesis>& one) {
        if (!one) return;
        hypotheses[kind] = {
            {"camera", one->camera < seen.cameras.size() ? seen.cameras[one->camera].name : ""},
            {"silhouette_residual_px", number(one->residual_px)},
            {"rotated_deg", number(one->rotated_deg)},
            {"moved_m", number(one->moved_m)},
            {"focal_factor", number(one->focal_factor)},
            {"shift_frames", number(one->shift_frames)}};
    };
    add("cameras_swapped", seen.rig.swapped);
    add("camera_moved", seen.rig.moved);
    add("intrinsics", seen.rig.intrinsics);
    add("all_intrinsics", seen.rig.all_intrinsics);
    add("camera_time", seen.rig.time);
    if (!hypotheses.empty()) out["hypotheses"] = std::move(hypotheses);
    Json cameras = Json::array();
    for (const CameraMeasurements& camera : seen.cameras) cameras.push_back(json_of(camera));
    out["cameras"] = std::move(cameras);
    return out;
}

// Those of judge_body.cc.
bool is_about_subject(const Cause& cause) {
    static constexpr std::array<std::string_view, 4> kCauses{"scale", "wrong_body", "silhouettes",
                                                             "withheld"};
    return std::ranges::find(kCauses, cause.cause) != kCauses.end();
}

// "2" or "2 (Anna)".
std::string subject_text(const Measurements& seen) {
    return seen.subject_name.empty() ? fmt::to_string(seen.subject_id)
                                     : fmt::format("{} ({})", seen.subject_id, seen.subject_name);
}

std::string short_number(const char* name, const std::optional<double>& value, int digits, double scale = 1,
                         const char* unit = "") {
    return value ? fmt::format(", {} {:.{}f}{}", name, scale * *value, digits, unit) : std::string();
}

}  // namespace

QualityReport judge(const Measurements& measurements) {
    // What spoils the images spoils everything after them; what spoils the cameras, the hull and the body.
    static constexpr std::array kJudges{judge_light, judge_background, judge_world,        judge_people,
                                        judge_time,  judge_intrinsics, judge_camera,       judge_view,
                                        judge_scale, judge_body,       judge_still_object, judge_silhouettes};
    QualityReport report;
    report.measurements = measurements;
    for (const auto& one : kJudges)
        if (Judgement found = one(measurements)) report.causes.push_back(*std::move(found));
    std::ranges::stable_sort(report.causes, std::ranges::greater{}, &Cause::trust);
    if (!report.causes.empty()) report.verdict = report.causes.front().trust;
    return report;
}

QualityReport judge_worst(std::span<const Measurements> subjects) {
    std::optional<QualityReport> worst;
    const auto is_worse = [](const QualityReport& one, const QualityReport& other) {
        if (one.verdict != other.verdict) return one.verdict > other.verdict;
        const PoseMeasurements &a = one.measurements.pose, &b = other.measurements.pose;
        if (a.withheld_fraction != b.withheld_fraction) return a.withheld_fraction > b.withheld_fraction;
        return a.joint_std_m.value_or(0) > b.joint_std_m.value_or(0);
    };
    for (const Measurements& subject : subjects) {
        QualityReport report = judge(subject);
        if (!worst || is_worse(report, *worst)) worst = std::move(report);
    }
    if (worst->measurements.followed_subjects > 1)
        for (Cause& cause : worst->causes)
            if (is_about_subject(cause))
                cause.reason = fmt::format("subject {}: {}", subject_text(worst->measurements), cause.reason);
    return *std::move(worst);
}

std::string quality_json(const QualityReport& report) {
    Json causes = Json::array();
    for (const Cause& cause : report.causes) causes.push_back(json_of(cause));
    Json out = {{"verdict", to_text(report.verdict)},
                {"cause", report.causes.empty() ? Json(nullptr) : causes.front()},
                {"causes", causes},
                {"measurements", json_of(report.measurements)}};
    return out.dump(2) + "\n";
}

std::string quality_text(const QualityReport& report) {
    const Measurements& seen = report.measurements;
    std::string out = fmt::format("quality: {}", to_text(report.verdict));
    out += short_number("posed body IoU", seen.pose.posed_iou, 2);
    out += short_number("hull IoU", seen.rig.hull_iou, 2);
    out += short_number("contour residual", seen.pose.contour_residual_m, 0, 1000, " mm");
    out += short_number("stated std", seen.pose.joint_std_m, 0, 1000, " mm");
    out += fmt::format(", withheld {:.1f} %", 100 * seen.pose.withheld_fraction);
    if (seen.followed_subjects > 1)
        out += fmt::format(" (subject {}, the worst of {})", subject_text(seen), seen.followed_subjects);
    out += '\n';
    if (report.causes.empty()) return out;
    const Cause& cause = report.causes.front();
    return out + fmt::format("  {}: {}\n  remedy: {}\n", cause.cause, cause.reason, cause.remedy);
}

}  // namespace kinevox::quality
