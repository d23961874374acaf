// Key poses that the arms make, on standing legs: raises, gestures, signals, throws; and turns of trunk and
// head.
#pragma once

#include <vector>

#include "server/pose/database/pose_library.h"

namespace kinevox::database {

void add_arm_poses(std::vector<LibraryPose>& poses);

}  // namespace kinevox::database
