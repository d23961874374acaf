// How bodies vary between persons: a Gaussian over the logarithms of stature, lengths and girths. A fit
// leaves to it what the silhouettes do not determine.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "server/pose/body_shape.h"

namespace kinevox {

// The lengths and, last, the stature.
inline constexpr int kBodyParameters = kBodyLengthCount + 1;
inline constexpr int kStatureParameter = kBodyLengthCount;
using BodyVector = Eigen::Matrix<double, kBodyParameters, 1>;
using BodyMatrix = Eigen::Matrix<double, kBodyParameters, kBodyParameters>;

class BodyPrior {
  public:
    // `stature_m`: measured, known to a few millimetres; else an adult's with this standard deviation.
    explicit BodyPrior(double stature_std_m, std::optional<double> stature_m = {});

    // Adds the cost's derivatives by the lengths and the stature (Gauss-Newton) and returns the cost.
    double add(const BodyShape& shape, BodyMatrix& hessian, BodyVector& gradient) const;

    // Covariance of log(length / (fraction * stature)) between persons.
    using Covariance = Eigen::Matrix<double, kBodyLengthCount, kBodyLengthCount>;
    static Covariance covariance();

  private:
    double stature_m_, stature_std_m_;
    Covariance precision_;
};

}  // namespace kinevox
