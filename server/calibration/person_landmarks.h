// Points of a person that silhouettes show about alike from every side: what cameras whose places are unknown
// have in common.
#pragma once

#include <array>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

// The top of the head (or of a raised arm), the middle of the silhouette's upper third, its centre of
// gravity. They lie within some centimetres of one place in the body whatever side it is seen from.
inline constexpr int kPersonLandmarks = 3;
using PersonLandmarks = std::array<Vec2, kPersonLandmarks>;  // px

// [moment][camera]; nothing where there is no silhouette or the picture's border cuts it. Cameras may be
// rolled by up to 60 degrees: what is up in a picture is taken from the body's own axis over all moments.
std::vector<std::vector<std::optional<PersonLandmarks>>> person_landmarks(const std::vector<Camera>& lenses,
                                                                          const SilhouetteSet& silhouettes);

}  // namespace kinevox
