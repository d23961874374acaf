// Body landmarks that silhouettes show similarly from every side: correspondences between cameras with
// unknown poses.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

// Top of the head (or of a raised arm), centroid of the silhouette's upper third, and its centroid. Each is
// within a few centimetres of one body point from any side.
inline constexpr int kPersonLandmarks = 3;
using PersonLandmarks = std::array<Vec2, kPersonLandmarks>;  // px

// [frame set][camera]; empty without a silhouette or if the image border truncates it. Cameras may be rolled
// by up to 60 degrees: up in the image is the body's axis over all frame sets.
std::vector<std::vector<std::optional<PersonLandmarks>>> person_landmarks(
    const std::vector<Camera>& intrinsics, const SilhouetteSet& silhouettes);

}  // namespace kinevox
