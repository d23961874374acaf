#include "common/geometry.h"

#include <Eigen/Geometry>

namespace kinevox {
namespace {

Mat3 to_mat3(const Eigen::Matrix3d& r) {
    Mat3 out;
    for (int row = 0; row < 3; ++row)
        for (int col = 0; col < 3; ++col) out(row, col) = r(row, col);
    return out;
}

}  // namespace

Mat3 rotation_from_rodrigues(Vec3 rotation_vector) {
    const double angle = norm(rotation_vector);
    if (angle == 0) return {};
    const Vec3 axis = rotation_vector / angle;
    return to_mat3(Eigen::AngleAxisd(angle, Eigen::Vector3d(axis.x, axis.y, axis.z)).toRotationMatrix());
}

Vec3 rodrigues_from_rotation(const Mat3& rotation) {
    Eigen::Matrix3d r;
    for (int row = 0; row < 3; ++row)
        for (int col = 0; col < 3; ++col) r(row, col) = rotation(row, col);
    const Eigen::AngleAxisd angle_axis(r);
    const Eigen::Vector3d v = angle_axis.angle() * angle_axis.axis();
    return {v.x(), v.y(), v.z()};
}

Mat3 rotation_x(double angle) {
    return rotation_from_rodrigues({angle, 0, 0});
}
Mat3 rotation_y(double angle) {
    return rotation_from_rodrigues({0, angle, 0});
}
Mat3 rotation_z(double angle) {
    return rotation_from_rodrigues({0, 0, angle});
}

}  // namespace kinevox
