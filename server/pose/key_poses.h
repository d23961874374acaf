// A few initial postures for use before the pose database is built.
#pragma once

#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

// Facing along x, the root at the world's origin; `coordinates` only of the joints.
const std::vector<BodyCoordinates>& key_poses();

// More starts for a body on the floor: outstretched on its back, front and sides, on all fours, sitting,
// kneeling.
const std::vector<BodyCoordinates>& floor_poses();

// The pose rotated to a heading (rad, from x towards y).
BodyCoordinates with_heading(const BodyCoordinates& pose, double heading);

// The pose moved so that the centroid of its volume is at that point.
BodyCoordinates centred(const BodyModel& model, const BodyCoordinates& pose, Vec3 centre_in_world);

}  // namespace kinevox
