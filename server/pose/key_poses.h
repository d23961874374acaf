// A few postures to begin with where nothing else is known, as a database is not built yet.
#pragma once

#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

// Facing along x, the root at the world's origin; `coordinates` only of the joints.
const std::vector<BodyCoordinates>& key_poses();

// The pose turned to a heading (rad, from x towards y).
BodyCoordinates with_heading(const BodyCoordinates& pose, double heading);

// The pose moved so that the middle of its surface (weighted by volume) lies at that point.
BodyCoordinates centred(const BodyModel& model, const BodyCoordinates& pose, Vec3 middle_in_world);

}  // namespace kinevox
