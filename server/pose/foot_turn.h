// Turns the feet of a fitted posture about their shanks: with the knee bent the shin rotates, and below the
// ankle the foot does, by up to 30 degrees together. The 32 degrees of freedom have only the ankle's hinge.
#pragma once

#include <span>

#include "server/pose/body_model.h"
#include "server/pose/pose_cost.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// rad about the foot's own vertical axis, counterclockwise seen from above.
double foot_turn(const BodyPosture& posture, int foot);
void add_foot_turn(double turn, int foot, BodyPosture& posture);

// Gauss-Newton steps of both feet's turns against the silhouettes; the rest of the posture stays.
void turn_feet(const BodyModel& model, std::span<const SilhouetteRays> views, double robust_m, int steps,
               PoseCost& cost, BodyPosture& posture);

}  // namespace kinevox
