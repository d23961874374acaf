// Our vectors as Eigen's. For sources that use Eigen anyway; our other headers do without it.
#pragma once

#include <Eigen/Core>

#include "common/geometry.h"

namespace kinevox {

inline Eigen::Vector3d to_eigen(Vec3 v) {
    return {v.x, v.y, v.z};
}

inline Eigen::Matrix3d to_eigen(const Mat3& m) {
    Eigen::Matrix3d out;
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) out(r, c) = m(r, c);
    return out;
}

inline Vec3 from_eigen(const Eigen::Vector3d& v) {
    return {v.x(), v.y(), v.z()};
}

}  // namespace kinevox
