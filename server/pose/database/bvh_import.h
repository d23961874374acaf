// A user's movement as poses of our body. Joints are recognised by name (those of CMU's, Mixamo's, Blender's,
// MakeHuman's and our own files), postures are taken from where the joints are, so that the file's zero pose
// does not matter.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "server/pose/database/bvh_reader.h"
#include "server/pose/database/pose_library.h"

namespace kinevox {

struct BvhImportOptions {
    double every_s = 0.1;  // one pose for so long a time, at least
    int max_poses = 500;   // spread over the file
};

// Labels are "NAME, 1.20 s". InvalidArgument names the joints that are unknown and those that are missing.
// Fingers, collar bones and the parts of the spine need not be there and may be.
absl::StatusOr<std::vector<LibraryPose>> poses_from_bvh(const BvhMotion& motion, const std::string& label,
                                                        const BvhImportOptions& options = {});

}  // namespace kinevox
