// The predefined poses: key poses of standing, walking, running, the sprint start, squats, lunges, jumps, arm
// movements, kicks and balance, and blends between them. Facing along x, the root at the world's origin.
#pragma once

#include <string>
#include <vector>

#include "server/pose/body_model.h"

namespace kinevox {

struct LibraryPose {
    std::string label;            // "walk 5/16, normal stride" for instance
    BodyCoordinates coordinates;  // root at the origin, heading 0
    bool added = false;           // by a user; such poses outlive a rebuild

    bool operator==(const LibraryPose&) const = default;
};

// The key poses, then blends of pairs and the legs of one with the trunk and arms of another until there are
// `count`; always the same ones. With a smaller count the key poses are thinned out evenly.
std::vector<LibraryPose> own_pose_library(int count);

// How many key poses there are.
int key_pose_count();

// Half way and so on from one pose to another, joint by joint along the shortest rotation; t in [0, 1].
BodyCoordinates blended(const BodyCoordinates& from, const BodyCoordinates& to, double t);

// Left and right exchanged.
BodyCoordinates mirrored(const BodyCoordinates& pose);

// Changes whenever the library does, so that a database built from another one is rebuilt.
inline constexpr int kPoseLibraryVersion = 1;

}  // namespace kinevox
