// From a fitted posture to what is published: joints, angles, and how far they can be trusted.
#pragma once

#include <memory>

#include "common/body_pose.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_cost.h"
#include "server/pose/pose_options.h"

namespace kinevox {

// Joints, angles, coordinates, orientations and ratios of a posture. What is marked as withheld in `out`
// becomes NaN; the rest of `out` stays as it is.
void describe_posture(const BodyModel& model, const BodyPosture& posture, BodyPose& out);

// Standard deviations, supporting cameras and reasons to withhold. `data` is the linearisation at the posture
// without any motion prior and `terms` the residuals it was made of.
void judge_posture(const BodyModel& model, const BodyPosture& posture, const Linearisation& data,
                   std::span<const SurfaceTerm> terms, std::span<const BodyCapsule> capsules, int cameras,
                   const EstimateOptions& options, BodyPose& out);

// The angles' velocities between two poses, rad/s; NaN where either is withheld.
void set_velocities(const BodyPose& before, BodyPose& pose);

}  // namespace kinevox
