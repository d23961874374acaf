#include "server/pose/body_prior.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace kinevox {
namespace {

constexpr double kMeasuredStd_m = 0.005;  // of a measured stature: posture, hair, time of day
// Of the chain from sole to head top over the stature, relative: the length of a standing body is the sum of
// its parts up to the spine's curves, shoes and hair.
constexpr double kChainStd = 0.008;
constexpr std::array<std::pair<BodyLength, double>, 6> kChain{{{kRootToSacroiliac, 1.045},
                                                               {kSacroiliacToSkullbase, 1},
                                                               {kSkullbaseToHeadTop, 1},
                                                               {kThigh, 1},
                                                               {kShank, 1},
                                                               {kAnkleHeight, 1}}};

// BodyLengthInfo::relative_std also holds differences between the sources' landmarks; this part of the
// variance is between persons.
constexpr double kBetweenPersons = 0.5;

// Common causes of differences from the mean proportions, and the relative difference that one std of
// each causes. The values are an estimate and not read from a table: with
// BodyLengthInfo::relative_std they correlate lengths of one limb by 0.3, girths of one limb by 0.7 and
// girths of different parts by 0.4 at equal stature. Correlations to compare with: Cheverud et al. 1990,
// Anthropometric Survey of US Army Personnel. Clothes act on whole limbs.
struct Cause {
    BodyLength length;
    double effect;
};
constexpr Cause kLegLength[] = {{kThigh, 0.022},
                                {kShank, 0.022},
                                {kUpperArm, 0.015},
                                {kForearm, 0.018},
                                {kHand, 0.015},
                                {kAnkleToToe, 0.015},
                                {kSacroiliacToSkullbase, -0.025},
                                {kSacroiliacToShoulders, -0.02}};
constexpr Cause kArmLength[] = {{kUpperArm, 0.025}, {kForearm, 0.025}, {kHand, 0.025}};
constexpr Cause kTrunkLength[] = {
    {kSacroiliacToSkullbase, 0.02}, {kSacroiliacToShoulders, 0.022}, {kRootToSacroiliac, 0.015}};
constexpr Cause kBuild[] = {
    {kPelvisHalfWidth, 0.08}, {kPelvisHalfDepth, 0.08},  {kWaistHalfWidth, 0.09}, {kWaistHalfDepth, 0.1},
    {kChestHalfWidth, 0.07},  {kChestHalfDepth, 0.08},   {kPelvisBack, 0.06},     {kWaistBack, 0.06},
    {kChestBack, 0.06},       {kNeckRadius, 0.08},       {kHeadRadius, 0.02},     {kThighRadius, 0.1},
    {kKneeRadius, 0.08},      {kCalfRadius, 0.09},       {kAnkleRadius, 0.05},    {kFootRadius, 0.04},
    {kUpperArmRadius, 0.1},   {kElbowRadius, 0.08},      {kForearmRadius, 0.09},  {kWristRadius, 0.06},
    {kHandRadius, 0.05},      {kShoulderHalfWidth, 0.01}};
// Half the difference between men and women at equal stature, towards the men; an estimate like the above.
// Means of both to compare with: Gordon et al. 2014, 2012 Anthropometric Survey of US Army Personnel (ANSUR
// II).
constexpr Cause kSex[] = {{kForearm, 0.02},
                          {kShank, 0.012},
                          {kThigh, 0.008},
                          {kSacroiliacToSkullbase, -0.02},
                          {kShoulderHalfWidth, 0.03},
                          {kPelvisHalfWidth, -0.035},
                          {kWaistHalfWidth, 0.03},
                          {kChestHalfWidth, 0.03},
                          {kNeckRadius, 0.055},
                          {kUpperArmRadius, 0.05},
                          {kForearmRadius, 0.05},
                          {kElbowRadius, 0.04},
                          {kWristRadius, 0.03},
                          {kThighRadius, -0.025},
                          {kPelvisBack, -0.05},
                          {kPelvisHalfDepth, -0.01},
                          {kFootRadius, 0.02},
                          {kHand, 0.02}};
constexpr Cause kTrousers[] = {{kPelvisHalfWidth, 0.03}, {kPelvisHalfDepth, 0.03}, {kThighRadius, 0.08},
                               {kKneeRadius, 0.1},       {kCalfRadius, 0.1},       {kAnkleRadius, 0.08}};
constexpr Cause kSleeves[] = {{kChestHalfWidth, 0.02}, {kChestHalfDepth, 0.03}, {kUpperArmRadius, 0.08},
                              {kElbowRadius, 0.1},     {kForearmRadius, 0.09},  {kWristRadius, 0.08},
                              {kWaistHalfWidth, 0.03}, {kWaistHalfDepth, 0.03}};

template <std::size_t kCount>
void add_cause(const Cause (&causes)[kCount], BodyPrior::Covariance& shared) {
    for (const Cause& a : causes)
        for (const Cause& b : causes) shared(a.length, b.length) += a.effect * b.effect;
}

}  // namespace

BodyPrior::Covariance BodyPrior::covariance() {
    Covariance sum = Covariance::Zero();
    add_cause(kLegLength, sum), add_cause(kArmLength, sum), add_cause(kTrunkLength, sum);
    add_cause(kSex, sum), add_cause(kBuild, sum), add_cause(kTrousers, sum), add_cause(kSleeves, sum);
    // The rest of each variance is its own, at least a fifth.
    for (int k = 0; k < kBodyLengthCount; ++k) {
        const double all = kBodyLengths[k].relative_std * kBodyLengths[k].relative_std;
        sum(k, k) = std::max(all, 1.25 * sum(k, k));
    }
    sum *= kBetweenPersons;
    // Given that the chain is as long as the stature.
    Eigen::Matrix<double, kBodyLengthCount, 1> chain;
    chain.setZero();
    for (const auto& [length, times] : kChain)
        chain(length) = times * kBodyLengths[length].fraction_of_stature;
    const Eigen::Matrix<double, kBodyLengthCount, 1> with = sum * chain;
    return sum - with * with.transpose() / (chain.dot(with) + kChainStd * kChainStd);
}

BodyPrior::BodyPrior(double stature_std_m, std::optional<double> stature_m)
    : stature_m_(stature_m.value_or(default_body_shape().stature_m)),
      stature_std_m_(stature_m ? kMeasuredStd_m : stature_std_m),
      precision_(covariance().ldlt().solve(Covariance::Identity())) {}

double BodyPrior::add(const BodyShape& shape, BodyMatrix& hessian, BodyVector& gradient) const {
    // Residuals and their derivatives by the lengths and, all alike, by the stature.
    Eigen::Matrix<double, kBodyLengthCount, 1> residual, by_length;
    for (int k = 0; k < kBodyLengthCount; ++k) {
        residual(k) = std::log(shape.lengths_m[k] / (kBodyLengths[k].fraction_of_stature * shape.stature_m));
        by_length(k) = 1 / shape.lengths_m[k];
    }
    const double by_stature = -1 / shape.stature_m;
    const Eigen::Matrix<double, kBodyLengthCount, 1> pull = precision_ * residual,
                                                     rows = precision_.rowwise().sum();
    hessian.topLeftCorner<kBodyLengthCount, kBodyLengthCount>() +=
        by_length.asDiagonal() * precision_ * by_length.asDiagonal();
    const Eigen::Matrix<double, kBodyLengthCount, 1> mixed = by_stature * by_length.cwiseProduct(rows);
    hessian.topRightCorner<kBodyLengthCount, 1>() += mixed;
    hessian.bottomLeftCorner<1, kBodyLengthCount>() += mixed.transpose();
    const double weight = 1 / (stature_std_m_ * stature_std_m_), off = shape.stature_m - stature_m_;
    hessian(kStatureParameter, kStatureParameter) += by_stature * by_stature * rows.sum() + weight;
    gradient.head<kBodyLengthCount>() += by_length.cwiseProduct(pull);
    gradient(kStatureParameter) += by_stature * pull.sum() + weight * off;
    return 0.5 * residual.dot(pull) + 0.5 * weight * off * off;
}

}  // namespace kinevox
