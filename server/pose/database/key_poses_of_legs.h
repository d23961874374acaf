// Key poses that the legs make: gaits, the sprint start, squats, lunges, jumps, kicks, balance.
#pragma once

#include <vector>

#include "server/pose/database/pose_library.h"

namespace kinevox::database {

void add_leg_poses(std::vector<LibraryPose>& poses);

}  // namespace kinevox::database
