// The true joints of a sequence: truth/joints.csv.
#pragma once

#include <array>
#include <filesystem>
#include <map>

#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox::testing {

using TrueJoints = std::array<Vec3, kJointNames.size()>;  // m, world, in the order of kJointNames

// By frame; empty where the file cannot be read.
std::map<int, TrueJoints> read_true_joints(const std::filesystem::path& file);

}  // namespace kinevox::testing
