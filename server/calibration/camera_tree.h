// Joins relative camera poses into one frame by a maximum spanning tree over the camera pairs, so that each
// pose comes from the pairs with the most shared views.
#pragma once

#include <vector>

#include "common/geometry.h"

namespace kinevox {

struct CameraPair {
    int a = 0, b = 0;  // camera indices
    Rigid3 a_from_b;
    int votes = 0;  // consistent frame sets
};

struct CameraTree {
    std::vector<Rigid3>
        camera_from_world;  // of the largest group; its best connected camera is the world frame
    std::vector<std::vector<int>> groups;  // connected cameras, largest group first
};

CameraTree join_cameras(int cameras, std::vector<CameraPair> pairs);

}  // namespace kinevox
