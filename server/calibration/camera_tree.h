// Cameras joined by what pairs of them have in common: a maximum spanning tree over the pairs, so that each
// camera's place comes over the pairs that saw most together.
#pragma once

#include <vector>

#include "common/geometry.h"

namespace kinevox {

struct CameraPair {
    int a = 0, b = 0;  // indices of cameras
    Rigid3 a_from_b;
    int votes = 0;  // moments that agree on it
};

struct CameraTree {
    std::vector<Rigid3>
        camera_from_world;  // of the largest group: its best connected camera is the world's origin
    std::vector<std::vector<int>> groups;  // cameras that are connected, the largest group first
};

CameraTree join_cameras(int cameras, std::vector<CameraPair> pairs);

}  // namespace kinevox
