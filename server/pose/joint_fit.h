// Optimises the lengths of a body and the postures of several frame sets together, by Levenberg-Marquardt
// steps.
#pragma once

#include <Eigen/Cholesky>
#include <array>
#include <stop_token>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/body_prior.h"
#include "server/pose/pose_cost.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

class JointFit {
  public:
    JointFit(std::vector<const PoseObservation*> frames, std::vector<BodyPosture> postures,
             const BodyShape& shape, const PoseStageOptions& posing, const BodyFitOptions& options,
             std::stop_token stop);

    // All frame sets count as `independent` ones: their errors are correlated, as the surface only
    // approximates the body. Returns the cost.
    double descend(double robust_m, int steps, double independent);
    // The same with long hair, and so with the head less far back.
    void grow_hair();
    void set_standing(std::size_t n);
    void set_shape(const BodyShape& shape) { shape_ = shape; }

    const BodyShape& shape() const { return shape_; }
    const std::vector<BodyPosture>& postures() const { return postures_; }
    // How unusual a body is.
    double prior_cost(const BodyShape& shape) const;
    // Per frame set, of its contour.
    std::vector<double> explained_fractions(double narrow_m) const;
    // Standard deviations of the lengths and, last, the stature, with free postures.
    std::array<double, kBodyParameters> std_m();
    double rms_m() const;

  private:
    using PoseMatrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
    using PointByShape = Eigen::Matrix<double, 3, kBodyParameters>;
    // Derivatives of joints and capsules in their segments' frames by the lengths: constant, since all are
    // linear.
    struct ShapeRates {
        struct Capsule {
            PointByShape a, b;
            Eigen::Matrix<double, 1, kBodyParameters> radius_a, radius_b;
        };
        std::array<PointByShape, kBodySegmentCount> offsets;
        std::vector<Capsule> capsules;

        explicit ShapeRates(const BodyShape& shape);
    };
    // The normal equations of one frame set, and their Schur complement after eliminating the posture.
    struct FrameSystem {
        Linearisation pose;
        Eigen::Matrix<double, kBodyDofCount, kBodyParameters> mixed;
        BodyMatrix shape;
        BodyVector shape_gradient;
        Eigen::LDLT<PoseMatrix> factor;
    };

    double linearise(const BodyShape& shape, const std::vector<BodyPosture>& postures);
    void add_shape(const BodyModel& model, const PoseCost& cost, FrameSystem& system) const;
    // Factorises the posture block of each frame set.
    void eliminate(double damping);
    BodyMatrix reduced_hessian() const;
    void step(double damping, BodyShape& shape, std::vector<BodyPosture>& postures);

    std::vector<const PoseObservation*> frames_;
    std::vector<BodyPosture> postures_;
    BodyShape shape_;
    BodyFitOptions options_;
    std::stop_token stop_;
    ShapeRates rates_;
    BodyPrior prior_;
    double robust_m_ = 0, share_ = 1;
    std::vector<PoseCost> costs_;
    std::vector<FrameSystem> systems_;
    BodyMatrix usual_;
    BodyVector usual_gradient_;
};

}  // namespace kinevox
