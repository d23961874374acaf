// The prior of the body's proportions.
#include "server/pose/body_prior.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

namespace kinevox {
namespace {

double cost(const BodyShape& shape, const BodyPrior& prior) {
    BodyMatrix hessian = BodyMatrix::Zero();
    BodyVector gradient = BodyVector::Zero();
    return prior.add(shape, hessian, gradient);
}

BodyShape scaled(std::initializer_list<BodyLength> lengths, double factor) {
    BodyShape shape = default_body_shape();
    for (const BodyLength k : lengths) shape[k] *= factor;
    return shape;
}

TEST(BodyPrior, CostsNothingAtMeanAndHasDefiniteCovariance) {
    EXPECT_NEAR(cost(default_body_shape(), BodyPrior(0.12)), 0, 1e-4);
    EXPECT_EQ(BodyPrior::covariance().llt().info(), Eigen::Success);
}

TEST(BodyPrior, GradientIsThatOfCost) {
    const BodyPrior prior(0.12);
    BodyShape shape = default_body_shape(1.6);
    for (int k = 0; k < kBodyLengthCount; ++k) shape.lengths_m[k] *= 1 + 0.05 * std::sin(k);
    BodyMatrix hessian = BodyMatrix::Zero();
    BodyVector gradient = BodyVector::Zero();
    prior.add(shape, hessian, gradient);
    constexpr double kStep = 1e-6;
    for (int k = 0; k < kBodyParameters; ++k) {
        BodyShape more = shape, less = shape;
        (k == kStatureParameter ? more.stature_m : more.lengths_m[k]) += kStep;
        (k == kStatureParameter ? less.stature_m : less.lengths_m[k]) -= kStep;
        const double numeric = (cost(more, prior) - cost(less, prior)) / (2 * kStep);
        EXPECT_NEAR(gradient(k), numeric, 1e-4 * std::abs(numeric) + 1e-3) << k;
    }
}

TEST(BodyPrior, ThinThighAloneIsLessLikelyThanThinPerson) {
    const BodyPrior prior(0.12);
    const double thigh = cost(scaled({kThighRadius}, 0.6), prior);
    const double person = cost(scaled({kThighRadius, kKneeRadius, kCalfRadius, kAnkleRadius}, 0.6), prior);
    EXPECT_GT(thigh, person);
    EXPECT_GT(cost(scaled({kThighRadius}, 0.35), prior), 10) << "a third of a thigh is absurd";
}

TEST(BodyPrior, LongLegsNeedShortTrunk) {
    const BodyPrior prior(0.12);
    const BodyShape legs = scaled({kThigh, kShank}, 1.05);
    BodyShape balanced = legs;
    for (const BodyLength k : {kRootToSacroiliac, kSacroiliacToSkullbase, kSacroiliacToShoulders})
        balanced[k] *= 0.95;
    EXPECT_LT(cost(balanced, prior), 0.7 * cost(legs, prior)) << "of the same stature";
}

TEST(BodyPrior, MeasuredStatureHolds) {
    const BodyPrior guessed(0.12), measured(0.12, 1.60);
    EXPECT_LT(cost(default_body_shape(1.60), measured), 0.01);
    EXPECT_GT(cost(default_body_shape(1.66), measured), 50);
    EXPECT_LT(cost(default_body_shape(1.66), guessed), 1);
}

}  // namespace
}  // namespace kinevox
