// Recognises the joints of a BVH file by their names.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <string>
#include <vector>

#include "server/pose/database/bvh_reader.h"

namespace kinevox {

enum BvhRole : int {
    kBvhRoot,
    kBvhSpine,
    kBvhNeck,
    kBvhHead,  // spine: the first joint above the root, neck: the first above the chest
    kBvhHipL,
    kBvhKneeL,
    kBvhAnkleL,
    kBvhToeL,
    kBvhShoulderL,
    kBvhElbowL,
    kBvhWristL,
    kBvhHipR,
    kBvhKneeR,
    kBvhAnkleR,
    kBvhToeR,
    kBvhShoulderR,
    kBvhElbowR,
    kBvhWristR,
    kBvhRoleCount
};

// Index of the joint of each role, -1 if an optional one (spine, head, toes) is absent.
absl::StatusOr<std::array<int, kBvhRoleCount>> bvh_roles(const std::vector<BvhJoint>& joints);

}  // namespace kinevox
