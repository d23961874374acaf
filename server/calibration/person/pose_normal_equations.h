// Normal equations in all camera poses, the sum over several kinds of observations.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace kinevox {

struct PoseNormalEquations {
    Eigen::MatrixXd
        square;  // 6 cameras x 6 cameras: left rotation and translation increments of camera_from_world
    Eigen::VectorXd right;
    double cost = 0;                  // robust
    std::vector<double> camera_cost;  // mean robust residual of each camera's observations, px
};

}  // namespace kinevox
