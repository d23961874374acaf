// Imports poses from BVH files. Joints are recognised by name (CMU, Mixamo, Blender, MakeHuman and Kinevox
// files); postures are computed from joint positions, independent of the file's zero pose.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "server/pose/database/bvh_reader.h"
#include "server/pose/database/pose_library.h"

namespace kinevox {

struct BvhImportOptions {
    double interval_s = 0.1;  // minimum time between poses
    int max_poses = 500;      // evenly spread over the file
};

// Labels are "NAME, 1.20 s". InvalidArgument names unknown and missing joints. Fingers, clavicles and the
// joints of the spine are optional.
absl::StatusOr<std::vector<LibraryPose>> poses_from_bvh(const BvhMotion& motion, const std::string& label,
                                                        const BvhImportOptions& options = {});

}  // namespace kinevox
