// Relative camera poses from a wand that both cameras detect, and the order of two equal balls.
#pragma once

#include <map>
#include <vector>

#include "common/camera.h"
#include "server/calibration/camera_tree.h"

namespace kinevox {

// [frame set][camera]: px, one per ball, from the first to the last.
using WandFrameSets = std::map<int, std::map<int, std::vector<Vec2>>>;

inline constexpr int kMinWandFrameSets = 12;  // shared by a pair of cameras

// Per pair of cameras with enough shared frame sets, their relative pose from the essential matrix; the scale
// comes from `balls` (m along the wand). Two equal balls are distinguished by their motion, which needs
// consecutive frame sets.
std::vector<CameraPair> wand_pairs(const std::vector<Camera>& intrinsics, const std::vector<Vec3>& balls,
                                   const WandFrameSets& frame_sets);

// Orders the two balls of each frame set so that the posed cameras are most consistent. Removes views of
// cameras with `has_pose` false, and frame sets that fewer than two of the others share.
void order_two_balls(const std::vector<Camera>& cameras, const std::vector<bool>& has_pose, double length_m,
                     WandFrameSets& frame_sets);

}  // namespace kinevox
