// Causes in the body: its scale, another person's body, silhouettes that it does not explain.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/quality/judges.h"

namespace kinevox::quality {
namespace {

// docs/quality.md lists the values measured on good and spoiled sessions next to each threshold.
constexpr double kMinStature_m = 1.35, kMaxStature_m = 2.12;
constexpr double kMinLitres = 46, kMaxLitres = 165;  // of an adult's hull
constexpr double kMinLitresStature_m = 1.75;         // of the adult with kMinLitres; of others by its cube
constexpr double kTall_m = 1.95;        // a fitted body is drawn towards the mean; the hull's height is not
constexpr double kExplainedIou = 0.88;  // of a posed body whose raised arms explain the hull's height
constexpr double kMaxStatureDifference = 0.045;  // of a given body against the fitted one
constexpr double kCautionIou = 0.75, kBadIou = 0.55, kCautionHullIou = 0.9;
constexpr double kCautionWithheld = 0.15;
constexpr double kMaxStd_m = 0.018;         // stated standard deviation of a pose that is determined
constexpr double kMinGap_m = 0.3;           // from the floor to the lowest point of an incomplete body
constexpr double kMaxShownFraction = 0.85;  // of the stature

// Other cameras may determine the joints where one lacks a part of the subject.
bool determines_pose(const PoseMeasurements& pose) {
    return pose.joint_std_m && *pose.joint_std_m < kMaxStd_m && pose.withheld_fraction <= kCautionWithheld;
}

}  // namespace

bool lacks_lower_body(const Measurements& seen) {
    return seen.body.stature_m && seen.world.lowest_m && seen.world.subject_height_m &&
           *seen.world.lowest_m > kMinGap_m &&
           *seen.world.subject_height_m < kMaxShownFraction * *seen.body.stature_m;
}

Judgement judge_scale(const Measurements& seen) {
    const std::optional<double> stature =
        seen.body.fitted_stature_m ? seen.body.fitted_stature_m : seen.body.stature_m;
    if (!stature) return {};
    const double height = seen.world.subject_height_m.value_or(*stature);
    // A body that cannot grow or shrink enough fits badly. Raised arms are part of a body that fits; a person
    // who only crouches has the usual volume.
    const double min_litres = kMinLitres * std::pow(*stature / kMinLitresStature_m, 3);
    const double litres = seen.world.volume_litres.value_or(min_litres);
    const bool large = seen.pose.posed_iou.value_or(1) < kExplainedIou && litres > kMaxLitres;
    const bool tall = *stature > kMaxStature_m || (height > kMaxStature_m && (*stature > kTall_m || large));
    const double highest = seen.world.max_height_m.value_or(*stature);
    const bool small = !lacks_lower_body(seen) && highest < kMinStature_m &&
                       seen.pose.posed_iou.value_or(1) < kCautionIou && litres < min_litres;
    if (*stature >= kMinStature_m && !tall && !small) return {};
    const double measured = tall ? std::max(height, *stature) : small ? highest : *stature;
    return Cause{
        Trust::kDoNotUse, "scale", "",
        fmt::format("the subject is measured {:.2f} m tall: the calibration's scale is wrong, or the "
                    "subject is a child",
                    measured),
        "measure the board's squares or the wand with a ruler and calibrate again with their true "
        "size"};
}

Judgement judge_body(const Measurements& seen) {
    if (!seen.body.given || !seen.body.stature_m || !seen.body.fitted_stature_m) return {};
    const double difference = *seen.body.stature_m / *seen.body.fitted_stature_m - 1;
    if (std::abs(difference) <= kMaxStatureDifference) return {};
    return Cause{Trust::kDoNotUse, "wrong_body", "",
                 fmt::format("the given body is {:.2f} m tall, the subject {:.2f} m", *seen.body.stature_m,
                             *seen.body.fitted_stature_m),
                 "give the body or T-pose of this subject, or none"};
}

Judgement judge_silhouettes(const Measurements& seen) {
    const Trust distrust = determines_pose(seen.pose) ? Trust::kCaution : Trust::kDoNotUse;
    if (lacks_lower_body(seen))
        return Cause{
            distrust, "silhouettes", "",
            fmt::format("the silhouettes end {:.2f} m above the floor and show {:.2f} m of a subject "
                        "of {:.2f} m: parts of the body are missing",
                        *seen.world.lowest_m, *seen.world.subject_height_m, *seen.body.stature_m),
            "record in clothes that differ from the floor and the walls, and check the silhouettes "
            "(--save silhouettes)"};
    if (seen.pose.posed_iou && *seen.pose.posed_iou < kCautionIou)
        return Cause{
            *seen.pose.posed_iou < kBadIou ? distrust : Trust::kCaution, "silhouettes", "",
            fmt::format("posed body and silhouettes overlap by {:.2f} only (IoU)", *seen.pose.posed_iou),
            "check the silhouettes (--save silhouettes): clothes like the background, shadows or "
            "missing parts"};
    if (seen.body.feet_unseen)
        return Cause{Trust::kCaution, "silhouettes", "",
                     "the silhouettes do not show the feet: their height and the legs' lengths follow from "
                     "the floor",
                     "wear shoes that differ from the floor, and check the silhouettes (--save silhouettes)"};
    if (seen.rig.hull_iou && *seen.rig.hull_iou < kCautionHullIou)
        return Cause{Trust::kCaution, "silhouettes", "",
                     fmt::format("silhouettes and cameras are inconsistent: hull IoU {:.2f}, residual {:.1f} "
                                 "px",
                                 seen.rig.hull_iou.value_or(0), seen.rig.residual_px.value_or(0)),
                     "check the silhouettes (--save silhouettes) and the calibration (kinevox calibrate "
                     "check)"};
    if (seen.pose.withheld_fraction > kCautionWithheld)
        return Cause{Trust::kCaution, "withheld", "",
                     fmt::format("{:.0f} % of the joints are withheld", 100 * seen.pose.withheld_fraction),
                     "add cameras, or move them so that they see all limbs"};
    return {};
}

}  // namespace kinevox::quality
