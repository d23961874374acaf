// Converts a fitted posture to the published pose: joints, angles and their uncertainty.
#pragma once

#include <array>
#include <memory>
#include <span>

#include "common/body_pose.h"
#include "server/pose/body_model.h"
#include "server/pose/missing_legs.h"
#include "server/pose/pose_cost.h"
#include "server/pose/pose_options.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// The two segments of each angle, in the order of kJointAngleNames.
struct SegmentPair {
    int first, second;
};
inline constexpr std::array<SegmentPair, kJointAngleNames.size()> kAngleSegments{{{kThighL, kShankL},
                                                                                  {kThighR, kShankR},
                                                                                  {kUpperArmL, kForearmL},
                                                                                  {kUpperArmR, kForearmR},
                                                                                  {kPelvis, kThighL},
                                                                                  {kPelvis, kThighR},
                                                                                  {kPelvis, kThighL},
                                                                                  {kPelvis, kThighR},
                                                                                  {kThorax, kUpperArmL},
                                                                                  {kThorax, kUpperArmR},
                                                                                  {kPelvis, kThorax}}};

// A prior without any images, so that the covariance is finite: the room, and any rotation.
inline constexpr double kRoomStd_m = 2, kRotationStd_rad = 1.5;

// Writes joints, angles, coordinates, orientations and ratios of a posture to `out`; values with a
// withheld_reason become NaN.
void describe_posture(const BodyModel& model, const BodyPosture& posture, BodyPose& out);

// Another posture that the frame sets allow, with its probability.
struct WeightedPosture {
    BodyPosture posture;
    double probability = 0;
};

// Writes standard deviations, camera counts and withheld reasons. `data` is the linearisation at the posture
// without motion prior, `terms` its residuals against `views`; `others` widen what they contradict.
void judge_posture(const BodyModel& model, const BodyPosture& posture, const Linearisation& data,
                   std::span<const SilhouetteRays> views, std::span<const SurfaceTerm> terms,
                   std::span<const BodyCapsule> capsules, std::span<const WeightedPosture> others,
                   int cameras, const EstimateOptions& options, BodyPose& out);

// Withholds joints and angles of the missing legs from the hips down, and of pelvis and waist if both are
// missing: then the silhouettes do not show where the trunk ends. Between judge_posture() and
// describe_posture().
void withhold_legs(const LegFlags& missing, BodyPose& out);

// Withholds what is beyond hips and shoulders and not withheld yet.
void withhold_limbs(BodyPose& out);

// Velocities between two poses, rad/s and m/s; NaN if either value is withheld.
void set_velocities(const BodyPose& before, BodyPose& pose);

}  // namespace kinevox
