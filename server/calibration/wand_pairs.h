// What two cameras conclude from a wand that both saw; and which of two alike balls is which.
#pragma once

#include <map>
#include <vector>

#include "common/camera.h"
#include "server/calibration/camera_tree.h"

namespace kinevox {

// [moment][camera]: px, a ball each, from the first to the last.
using WandMoments = std::map<int, std::map<int, std::vector<Vec2>>>;

inline constexpr int kMinWandMoments = 12;  // that a pair of cameras needs in common

// Per pair of cameras with enough moments in common, their relative place from the essential matrix, its
// scale from `balls` (m along the wand). Two alike balls are told apart by how they move on: only where
// moments follow each other.
std::vector<CameraPair> wand_pairs(const std::vector<Camera>& lenses, const std::vector<Vec3>& balls,
                                   const WandMoments& moments);

// Puts each moment's two balls into the order in which its cameras (placed) agree best. Views of cameras with
// `placed` false are removed, and moments that fewer than two of the others saw.
void order_two_balls(const std::vector<Camera>& cameras, const std::vector<bool>& placed, double length_m,
                     WandMoments& moments);

}  // namespace kinevox
