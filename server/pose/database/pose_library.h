// The library poses: key poses of standing, walking, running, the sprint start, squats, lunges, jumps, arm
// movements, kicks and balance, and blends of them. Facing along x, the root at the world's origin.
#pragma once

#include <string>
#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

struct LibraryPose {
    std::string label;            // for example "walk 5/16, normal stride"
    BodyCoordinates coordinates;  // root at the origin, heading 0
    bool user_defined = false;    // added by a user; kept when the database is rebuilt

    bool operator==(const LibraryPose&) const = default;
};

// The key poses, then blends of pairs, and the legs of one with the trunk and arms of another, up to `count`;
// deterministic. With a smaller count, an even subset of the key poses.
std::vector<LibraryPose> library_poses(int count);

// Number of key poses.
int key_pose_count();

// Interpolates between two poses, each joint along the shortest rotation; t in [0, 1].
BodyCoordinates blended(const BodyCoordinates& from, const BodyCoordinates& to, double t);

// The pose with left and right swapped.
BodyCoordinates mirrored(const BodyCoordinates& pose);

// Incremented with each change of the library, so that databases of an older one are rebuilt.
inline constexpr int kPoseLibraryVersion = 2;

}  // namespace kinevox
