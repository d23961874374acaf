// Causes in cameras and calibration.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/quality/judges.h"

namespace kinevox::quality {
namespace {

// docs/quality.md lists the values measured on good and spoiled sessions next to each threshold.
constexpr double kMaxResidualFraction = 0.0009;  // of the image's longer side
constexpr double kMinHullIou = 0.92;             // of a camera
constexpr double kExplains = 0.6;        // of the residual that at most remains under a true hypothesis
constexpr double kExplainsFully = 0.35;  // a move imitates a shift in time, but not of the limbs
constexpr double kSwapExplains = 0.5;
constexpr double kMinShiftFrames = 0.75;
// Where only some frame sets contradict each other; other causes imitate small shifts there.
constexpr double kMinLowHullIou = 0.96;
constexpr double kMinShiftOfSome_frames = 1.5;
constexpr double kMaxTilt_deg = 6;
constexpr double kMaxFloor_m = 0.12;
constexpr double kMinBelowFraction = 0.99;

std::string name_of(const Measurements& seen, std::size_t camera) {
    return camera < seen.cameras.size() ? seen.cameras[camera].name : std::string();
}

bool explains(const RigMeasurements& rig, const std::optional<RigHypothesis>& hypothesis, double fraction) {
    return rig.residual_px && hypothesis && hypothesis->residual_px < fraction * *rig.residual_px;
}

double residual_or_infinite(const std::optional<RigHypothesis>& hypothesis) {
    return hypothesis ? hypothesis->residual_px : std::numeric_limits<double>::infinity();
}

// A camera's pose, intrinsics or place in the session remove the contradiction.
bool is_explained_without_time(const RigMeasurements& rig) {
    for (const auto& one : {rig.swapped, rig.moved, rig.intrinsics, rig.all_intrinsics})
        if (explains(rig, one, kExplainsFully)) return true;
    return false;
}

}  // namespace

bool rig_is_inconsistent(const RigMeasurements& rig) {
    return (rig.residual_px && *rig.residual_px > kMaxResidualFraction * rig.side_px) ||
           (rig.min_hull_iou && *rig.min_hull_iou < kMinHullIou);
}

bool time_is_doubtful(const RigMeasurements& rig) {
    if (rig_is_inconsistent(rig)) return !is_explained_without_time(rig);
    return rig.low_hull_iou && *rig.low_hull_iou < kMinLowHullIou;
}

Judgement judge_time(const Measurements& seen) {
    if (!seen.rig.time || !time_is_doubtful(seen.rig)) return {};
    const RigHypothesis& time = *seen.rig.time;
    const double min_shift = rig_is_inconsistent(seen.rig) ? kMinShiftFrames : kMinShiftOfSome_frames;
    if (std::abs(time.shift_frames) < min_shift) return {};
    const std::string name = name_of(seen, time.camera);
    return Cause{Trust::kDoNotUse, "camera_time", name,
                 fmt::format("the images of camera {} are {:.1f} frames {} than those of the others", name,
                             std::abs(time.shift_frames), time.shift_frames > 0 ? "later" : "earlier"),
                 "run kinevox sync on the session, then process it again"};
}

Judgement judge_intrinsics(const Measurements& seen) {
    const RigMeasurements& rig = seen.rig;
    if (!rig_is_inconsistent(rig)) return {};
    const double one = residual_or_infinite(rig.intrinsics), all = residual_or_infinite(rig.all_intrinsics),
                 other = std::min(residual_or_infinite(rig.moved), residual_or_infinite(rig.swapped));
    if (explains(rig, rig.all_intrinsics, kExplains) && all < other && all < one)
        return Cause{Trust::kDoNotUse, "intrinsics", "",
                     fmt::format("the intrinsics do not match the images: with focal lengths of {:.2f} times "
                                 "the calibrated ones the silhouette residual is {:.1f} px instead of {:.1f}",
                                 rig.all_intrinsics->focal_factor, all, *rig.residual_px),
                     "use a calibration made with this focus, zoom and resolution"};
    if (!explains(rig, rig.intrinsics, kExplains) || one > other) return {};
    const std::string name = name_of(seen, rig.intrinsics->camera);
    return Cause{Trust::kDoNotUse, "intrinsics", name,
                 fmt::format("the intrinsics of camera {} do not match its images: with {:.2f} times its "
                             "calibrated focal length the silhouette residual is {:.1f} px instead of {:.1f}",
                             name, rig.intrinsics->focal_factor, one, *rig.residual_px),
                 "calibrate the intrinsics of this camera again, with its focus, zoom and resolution as in "
                 "the session"};
}

Judgement judge_camera(const Measurements& seen) {
    const RigMeasurements& rig = seen.rig;
    if (!rig_is_inconsistent(rig)) return {};
    const double moved = residual_or_infinite(rig.moved);
    if (explains(rig, rig.swapped, kSwapExplains) && rig.swapped->residual_px < moved)
        return Cause{Trust::kDoNotUse, "cameras_swapped", name_of(seen, rig.swapped->camera),
                     fmt::format("cameras {} and {} are swapped: exchanged, the silhouette residual is "
                                 "{:.1f} px instead of {:.1f}",
                                 name_of(seen, rig.swapped->camera), name_of(seen, rig.swapped->other),
                                 rig.swapped->residual_px, *rig.residual_px),
                     "exchange their videos or cables"};
    if (!explains(rig, rig.moved, kExplains)) return {};
    const std::string name = name_of(seen, rig.moved->camera);
    return Cause{Trust::kDoNotUse, "camera_moved", name,
                 fmt::format("camera {} has moved since it was calibrated, by {:.1f} degrees and {:.0f} mm",
                             name, rig.moved->rotated_deg, 1000 * rig.moved->moved_m),
                 "calibrate the extrinsics again"};
}

Judgement judge_world(const Measurements& seen) {
    const WorldMeasurements& world = seen.world;
    if (world.cameras_below_fraction > kMinBelowFraction || (world.tilt_deg && *world.tilt_deg > 120))
        return Cause{Trust::kDoNotUse, "world_upside_down", "",
                     "the world is upside down: the cameras are below its floor or see it overhead",
                     "define the floor again, with the board face up (kinevox calibrate floor)"};
    if (world.tilt_deg && *world.tilt_deg > kMaxTilt_deg)
        return Cause{
            Trust::kDoNotUse, "world_tilted", "",
            fmt::format("the world is tilted by {:.0f} degrees against the vertical", *world.tilt_deg),
            "define the floor again (kinevox calibrate floor)"};
    // Feet in the floor's colour are missing in the hull, not in the pose.
    const bool stands =
        world.lowest_m.value_or(0) > 0 && seen.pose.lowest_m.value_or(kMaxFloor_m) < kMaxFloor_m;
    if (world.lowest_m && std::abs(*world.lowest_m) > kMaxFloor_m && !rig_is_inconsistent(seen.rig) &&
        !lacks_lower_body(seen) && !stands)
        return Cause{Trust::kCaution, "floor_height", "",
                     fmt::format("the subject's lowest point is {:.2f} m {} the floor",
                                 std::abs(*world.lowest_m), *world.lowest_m < 0 ? "under" : "above"),
                     "define the floor again (none if the subject stands on an object)"};
    return {};
}

}  // namespace kinevox::quality
