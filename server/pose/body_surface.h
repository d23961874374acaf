// The capsules of the surface of a body.
#pragma once

#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

// Fractions of their lengths by which the fingertips of a relaxed hand are behind the forearm's axis and the
// toes outwards of the ankle.
inline constexpr double kHandBack = 0.10, kToeOut = 0.14;

// Midpoint of the hips from the root, fractions of the length from root to sacroiliac: the root is in front
// of the sacrum, just above the line between the hips.
inline constexpr double kHipsBehindRoot = 0.06, kHipsBelowRoot = 0.045;

// In the segments' own frames. Each number in it is linear in the lengths of the shape, the order never
// changes.
std::vector<BodyCapsule> body_surface(const BodyShape& shape);

}  // namespace kinevox
