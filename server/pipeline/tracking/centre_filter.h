// Kalman filter of the subject's centre: constant velocity with white acceleration noise.
#pragma once

#include <array>

#include "common/geometry.h"

namespace kinevox {

struct CentreFilterOptions {
    double acceleration_std_m_per_s2 = 6;  // of people: about that of a sprinter's push-off
    double initial_speed_std_m_per_s = 2;  // of a new subject
    bool operator==(const CentreFilterOptions&) const = default;
};

class CentreFilter {
  public:
    explicit CentreFilter(const CentreFilterOptions& options = {}) : options_(options) {}

    // Starts at a measured centre, at rest. `covariance_m2` is the measurement's.
    void start(Vec3 centre_in_world, const Mat3& covariance_m2);
    // Predicts the state after `seconds` >= 0.
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
