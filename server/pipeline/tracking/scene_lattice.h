// The lattice of the coarse hull in which several people are tracked.
#pragma once

#include <vector>

#include "common/camera.h"
#include "kernels/types.h"

namespace kinevox {

inline constexpr double kSceneFloor_m = -0.16;  // its lowest point

// Cells of 40 mm over the space that enough cameras see at chest height, up to 2.56 m.
kernels::Lattice scene_lattice(const std::vector<Camera>& cameras);

}  // namespace kinevox
