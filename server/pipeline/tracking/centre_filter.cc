#include "server/pipeline/tracking/centre_filter.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace kinevox {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using RowMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

}  // namespace

void CentreFilter::start(Vec3 centre_in_world, const Mat3& covariance_m2) {
    state_ = {centre_in_world.x, centre_in_world.y, centre_in_world.z, 0, 0, 0};
    Eigen::Map<Matrix6> p(covariance_.data());
    p.setZero();
    p.topLeftCorner<3, 3>() = Eigen::Map<const RowMatrix3>(covariance_m2.m.data());
    p.bottomRightCorner<3, 3>().diagonal().setConstant(options_.initial_speed_std_m_per_s *
                                                       options_.initial_speed_std_m_per_s);
}

void CentreFilter::predict(double seconds) {
    const double t = std::max(seconds, 0.0),
                 q = options_.acceleration_std_m_per_s2 * options_.acceleration_std_m_per_s2;
    Eigen::Map<Vector6> x(state_.data());
    Eigen::Map<Matrix6> p(covariance_.data());
    Matrix6 f = Matrix6::Identity();
    f.topRightCorner<3, 3>().diagonal().setConstant(t);
    x = f * x;
    // An acceleration that is constant over one step: position t^2/2, velocity t.
    Matrix6 noise = Matrix6::Zero();
    noise.topLeftCorner<3, 3>().diagonal().setConstant(q * t * t * t * t / 4);
    noise.topRightCorner<3, 3>().diagonal().setConstant(q * t * t * t / 2);
    noise.bottomLeftCorner<3, 3>().diagonal().setConstant(q * t * t * t / 2);
    noise.bottomRightCorner<3, 3>().diagonal().setConstant(q * t * t);
    p = (f * p * f.transpose() + noise).eval();
}

void CentreFilter::correct(Vec3 centre_in_world, const Mat3& covariance_m2) {
    Eigen::Map<Vector6> x(state_.data());
    Eigen::Map<Matrix6> p(covariance_.data());
    const RowMatrix3 r = Eigen::Map<const RowMatrix3>(covariance_m2.m.data());
    const Eigen::Vector3d measured(centre_in_world.x, centre_in_world.y, centre_in_world.z);
    const Eigen::Matrix3d innovation = p.topLeftCorner<3, 3>() + r;
    const Eigen::Matrix<double, 6, 3> gain = p.leftCols<3>() * innovation.inverse();
    x += gain * (measured - x.head<3>());
    Matrix6 keep = Matrix6::Identity();
    keep.leftCols<3>() -= gain;
    p = (keep * p * keep.transpose() + gain * r * gain.transpose()).eval();  // Joseph: stays symmetric
}

Vec3 CentreFilter::centre_in_world() const {
    return {state_[0], state_[1], state_[2]};
}
Vec3 CentreFilter::velocity_in_world() const {
    return {state_[3], state_[4], state_[5]};
}

double CentreFilter::centre_std_m() const {
    return std::sqrt((covariance_[0] + covariance_[7] + covariance_[14]) / 3);
}

}  // namespace kinevox
