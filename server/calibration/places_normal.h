// Normal equations over the places of all cameras: what several kinds of observations add up to.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace kinevox {

struct PlacesNormal {
    Eigen::MatrixXd square;  // 6 cameras x 6 cameras: turn and shift of camera_from_world, from the left
    Eigen::VectorXd right;
    double cost = 0;                  // robust
    std::vector<double> camera_cost;  // mean robust miss of each camera's observations, px
};

}  // namespace kinevox
