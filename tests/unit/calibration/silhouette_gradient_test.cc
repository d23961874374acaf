// Analytic derivatives of the silhouette costs by the camera poses against numeric ones.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <functional>

#include "common/geometry.h"
#include "server/calibration/person/silhouette_residuals.h"
#include "server/cameras/studio/staging.h"
#include "tests/unit/calibration/studio_silhouettes.h"

namespace kinevox {
namespace {

using Cost = std::function<PoseNormalEquations(const std::vector<Camera>&, bool with_derivatives)>;

// The step that PoseNormalEquations counts from the left: rotation vector and translation.
std::vector<Camera> stepped(std::vector<Camera> cameras, std::size_t column, double step) {
    double values[6] = {};
    values[column % 6] = step;
    Rigid3& pose = cameras[column / 6].camera_from_world;
    pose = Rigid3{rotation_from_rodrigues({values[0], values[1], values[2]}),
                  {values[3], values[4], values[5]}} *
           pose;
    return cameras;
}

struct GradientError {
    double relative =
        0;  // norm of the difference to central differences of the cost, over the gradient's norm
    double angle_deg = 0;  // between the two
};
GradientError gradient_error(const Cost& cost, const std::vector<Camera>& cameras, double step) {
    // The normal equations hold minus half the gradient.
    const Eigen::VectorXd analytic = -2 * cost(cameras, true).right;
    Eigen::VectorXd numeric(analytic.size());
    for (int k = 0; k < analytic.size(); ++k) {
        const auto column = static_cast<std::size_t>(k);
        numeric(k) = (cost(stepped(cameras, column, step), false).cost -
                      cost(stepped(cameras, column, -step), false).cost) /
                     (2 * step);
    }
    EXPECT_GT(analytic.norm(), 1);
    return {(numeric - analytic).norm() / analytic.norm(),
            degrees(std::acos(numeric.dot(analytic) / (numeric.norm() * analytic.norm())))};
}

class SilhouetteGradient : public ::testing::Test {
  protected:
    SilhouetteGradient() {
        wrong_[0] = studio::bumped_camera(wrong_[0], {0.004, 0.012, -0.006}, {0.02, 0, 0.01});
        wrong_[2] = studio::bumped_camera(wrong_[2], {-0.008, 0.004, 0.01}, {0, 0.015, -0.02});
    }

    const testing::StudioSilhouettes seen_ = testing::studio_silhouettes("walk", 4, 8, 11);
    std::vector<Camera> wrong_ = seen_.cameras;
};

// Bounds are the measured values (printed as properties) plus 15 %. The smallest residual of a ray often lies
// on a ridge of the distance field, which is not smooth: the gradient is shorter there, but has the
// direction.
TEST_F(SilhouetteGradient, OfContourRaysMatchesNumericDifferences) {
    const ContourRayCost rays(wrong_, seen_.set, {});
    const auto cost = [&](const std::vector<Camera>& cameras, bool with_derivatives) {
        return rays.measure(cameras, 8, with_derivatives);
    };
    const GradientError error = gradient_error(cost, wrong_, 2e-4);
    RecordProperty("relative_error", std::to_string(error.relative));
    RecordProperty("angle_deg", std::to_string(error.angle_deg));
    EXPECT_LT(error.relative, 0.215);
    EXPECT_LT(error.angle_deg, 4.0);
}

// Without the change of the planes' weights, and of the tangent points along the contour.
TEST_F(SilhouetteGradient, OfTangentPlanesMatchesNumericDifferences) {
    const SilhouetteTangents tangents(wrong_, seen_.set);
    const auto cost = [&](const std::vector<Camera>& cameras, bool with_derivatives) {
        return tangents.measure(cameras, 8, with_derivatives);
    };
    const GradientError error = gradient_error(cost, wrong_, 2e-4);
    RecordProperty("relative_error", std::to_string(error.relative));
    EXPECT_LT(error.relative, 0.011);
}

}  // namespace
}  // namespace kinevox
