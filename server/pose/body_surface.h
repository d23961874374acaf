// The surface of a body of given proportions: which capsules, where.
#pragma once

#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

// In the segments' own frames. Each number in it is linear in the lengths of the shape, the order never changes.
std::vector<BodyCapsule> body_surface(const BodyShape& shape);

}  // namespace kinevox
