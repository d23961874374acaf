// Converts a fitted posture to the published pose: joints, angles and their uncertainty.
#pragma once

#include <memory>
#include <span>

#include "common/body_pose.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_cost.h"
#include "server/pose/pose_options.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// Writes joints, angles, coordinates, orientations and ratios of a posture to `out`; values with a
// withheld_reason become NaN.
void describe_posture(const BodyModel& model, const BodyPosture& posture, BodyPose& out);

// Another posture that the frame sets allow, with its probability.
struct WeightedPosture {
    BodyPosture posture;
    double probability = 0;
};

// Writes standard deviations, camera counts and withheld reasons. `data` is the linearisation at the posture
// without motion prior, `terms` its residuals; `others` widen what they contradict.
void judge_posture(const BodyModel& model, const BodyPosture& posture, const Linearisation& data,
                   std::span<const SurfaceTerm> terms, std::span<const BodyCapsule> capsules,
                   std::span<const WeightedPosture> others, int cameras, const EstimateOptions& options,
                   BodyPose& out);

// Legs that the silhouettes lack fold up, hide in the trunk or extend beyond the silhouettes, and the body
// floats: nothing of it is seen near the floor (world z = 0), and of each leg the ankle is outside most
// silhouettes, above the hip, or nearer to it than half of the leg's length.
bool lacks_legs(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views);

// A body that lacks its legs for longer is not one in a jump; then they must be seen for as long as
// kMinLegsSeen_s before they are believed again, since clothes like the background appear briefly.
inline constexpr double kMaxJump_s = 0.8, kMinLegsSeen_s = 0.3;

// Withholds joints and angles from the hips down; between judge_posture() and describe_posture().
void withhold_legs(BodyPose& out);

// Velocities between two poses, rad/s and m/s; NaN if either value is withheld.
void set_velocities(const BodyPose& before, BodyPose& pose);

}  // namespace kinevox
