// Kalman filter over the subject's centre: constant velocity, disturbed by white acceleration.
#pragma once

#include <array>

#include "common/geometry.h"

namespace kinevox {

struct CentreFilterOptions {
    double acceleration_std_m_s2 = 6;  // of people: a sprinter's push-off reaches about this
    double first_speed_std_m_s = 2;    // of a subject just found
};

class CentreFilter {
  public:
    explicit CentreFilter(const CentreFilterOptions& options = {}) : options_(options) {}

    // Starts at a measured centre, at rest. `covariance_m2` is the measurement's.
    void start(Vec3 centre_in_world, const Mat3& covariance_m2);
    // Moves the state on by `seconds` >= 0.
    void predict(double seconds);
    void correct(Vec3 centre_in_world, const Mat3& covariance_m2);

    Vec3 centre_in_world() const;    // m
    Vec3 velocity_in_world() const;  // m/s
    double centre_std_m() const;     // one axis, root mean square of the three

  private:
    CentreFilterOptions options_;
    std::array<double, 6> state_{};        // position, velocity
    std::array<double, 36> covariance_{};  // row major
};

}  // namespace kinevox
