#include "server/pose/pose_estimate.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <bitset>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <string>

#include "common/body_pose.h"
#include "common/geometry.h"
#include "server/pose/ray_capsule.h"

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr int kMinSupportTerms = 4;  // minimum residuals of a camera on a segment to support it
constexpr int kMaxCameras = 64;
// Of the joints, beside others: a tenth of what remains of the limbs then has gross errors.
constexpr double kMaxWithheld = 1.0 / 3;
constexpr double kMinProbability = 1e-4;

using Matrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
using Vector = Eigen::Matrix<double, kBodyDofCount, 1>;
using CameraSet = std::bitset<kMaxCameras>;

std::array<CameraSet, kBodySegmentCount> supporting_cameras(std::span<const SurfaceTerm> terms,
                                                            std::span<const BodyCapsule> capsules) {
    std::array<std::array<int, kMaxCameras>, kBodySegmentCount> counts{};
    for (const SurfaceTerm& term : terms)
        if (term.camera >= 0 && term.camera < kMaxCameras)
            ++counts[capsules[term.capsule].segment][term.camera];
    std::array<CameraSet, kBodySegmentCount> sets;
    for (int s = 0; s < kBodySegmentCount; ++s)
        for (int c = 0; c < kMaxCameras; ++c) sets[s][c] = counts[s][c] >= kMinSupportTerms;
    return sets;
}

// What the errors of a joint depend on, left and right alike.
struct JointError {
    std::string_view joint;
    // Of the body model, which the silhouettes do not show: joint centres inside a body of capsules. Per
    // axis.
    double model_std_m;
    // A gross error: the limb is somewhere else than the fit has put it. Its odds fall with the rays that
    // touch the segment alone and grow with the misfit of the others (per 20 mm). Logistic regression within
    // the maximum likelihood of Weights; standard deviation per axis.
    double gross_log_odds, gross_std_m;
    // By a body that is not the subject's, relative to EstimateOptions::body_std_m: too tall a body bends its
    // neck to stay within the silhouettes, and its hips are too high.
    double of_other_body = 1;
    double of_own_misfit = 0.056;  // weight of the segment's misfit; hair turns the head and misfits it
};
// Ankles without gross errors: feet of a real person, bare or in shoes, are unlike the model's and touch few
// rays at their right place, too.
constexpr JointError kJointErrors[] = {{"root", 0.004, 4.7, 0.057},
                                       {"sacroiliac", 0.007, -0.8, 0.06},
                                       {"skullbase", 0.007, -1.7, 0.06, 1.4},
                                       {"head_top", 0.005, -1.4, 0.07, 2.4, 0.6},
                                       {"shoulder", 0.009, 2.6, 0.06},
                                       {"elbow", 0.0075, -0.9, 0.11},
                                       {"wrist", 0.0075, -1.1, 0.15},
                                       {"hand", 0.0075, -0.3, 0.2},
                                       {"hip", 0.0075, -6.0, 0.06, 1.4},
                                       {"knee", 0.0055, 4.6, 0.16},
                                       {"ankle", 0.005, 0, 0},
                                       {"toe", 0.005, 4.2, 0.07}};
constexpr double kOfTouching = -4.9, kOfMisfit = 0.33, kOddsScale_m = 0.02;
// In the order of kJointNames.
constexpr std::array<JointError, kJointNames.size()> kErrorOfJoint = [] {
    std::array<JointError, kJointNames.size()> errors{};
    for (std::size_t j = 0; j < errors.size(); ++j)
        errors[j] = *std::ranges::find_if(
            kJointErrors, [&](const JointError& e) { return kJointNames[j].starts_with(e.joint); });
    return errors;
}();

// Angles in the order of kJointAngleNames, rad: each side's knee, elbow, hip flexion and abduction, shoulder,
// and the trunk.
constexpr std::array<double, kJointAngleNames.size()> kModelAngleStd{
    2.0 * kDegree, 2.0 * kDegree, 3.5 * kDegree, 3.5 * kDegree, 4.0 * kDegree, 4.0 * kDegree,
    1.5 * kDegree, 1.5 * kDegree, 2.8 * kDegree, 2.8 * kDegree, 1.4 * kDegree};
// A segment's rotation against its parent, rad: that of the angle at the same joint, else (neck, ankle,
// wrist) the far joint's position error over the segment's length.
double model_rotation_std(int segment) {
    switch (segment) {
        case kShankL:
        case kShankR:
            return kModelAngleStd[0];
        case kForearmL:
        case kForearmR:
            return kModelAngleStd[2];
        case kUpperArmL:
        case kUpperArmR:
            return kModelAngleStd[8];
        case kPelvis:
        case kThorax:
        case kThighL:
        case kThighR:
            return kModelAngleStd[4];
        default:
            return 4 * kDegree;
    }
}

// How far the contours are from the fitted body, m^2: of the whole body and of each segment. `touching`: rays
// that touch a segment and no other part of the body, of kRays.
struct Misfit {
    double all = 0;
    std::array<double, kBodySegmentCount> segment{}, touching{};
};

// Weights of the parts of a variance, by maximum likelihood over the errors of `kinevox process` on the
// shared sequences and on random bodies, rigs and rates of tests/accuracy/sweep.py, which shows what they
// achieve as rates.py does. Errors have Student's distribution there (8 degrees of freedom), so that rare
// large ones do not widen all; the standard deviations are 1.16 times its scale.
constexpr double kUsualMisfit_m2 = 0.0004;  // of a well fitted body
struct Weights {
    double data, ambiguity, doubtful_ambiguity;
};
constexpr Weights kOfJoints{0.13, 0.3, 2.6}, kOfAngles{0.1, 0.4, 1.23};
constexpr double kOfAllMisfit = 0.025, kOfParentMisfit = 0.026, kParentMisfit_m2 = 0.0009,
                 kOfRootMisfit = 0.07;
// Beyond this the silhouettes do not determine a value, whatever their misfit (m and rad).
constexpr double kUndetermined2 = 0.02 * 0.02, kOfUndetermined = 0.7;
constexpr double kMaxResidual_m = 0.12;
constexpr double kLimb_m = 0.3;    // typical length, over which an error of a joint turns an angle
constexpr double kSharedRays = 8;  // a segment with few rays of its own misfits as the whole body does
// Where a border has no contrast, the silhouette lacks a part, and the body fits it this badly.
constexpr double kWithoutContrast_m = 0.05;
constexpr double kRays = 160;  // to which touching rays are scaled
constexpr double kMaxTouching_m = 0.015, kMaxElsewhere_m = 0.03;

// Whether another part of the body, not joined to the term's segment, may have caused the ray.
bool explained_elsewhere(const ContourRays& rays, const SurfaceTerm& term,
                         std::span<const BodyCapsule> capsules) {
    const auto of_ray = [&](const auto& vectors) {
        return Vec3{vectors[0][term.ray], vectors[1][term.ray], vectors[2][term.ray]};
    };
    const Vec3 origin = rays.origin_in_world, direction = of_ray(rays.direction),
               outward = of_ray(rays.outward);
    const int segment = capsules[term.capsule].segment;
    return std::ranges::any_of(capsules, [&](const BodyCapsule& other) {
        const int s = other.segment;
        if (s == segment || kBodyParent[s] == segment || kBodyParent[segment] == s) return false;
        if (distance_to_ball_m(origin, direction, other) > kMaxElsewhere_m) return false;
        const RayTouch touch = touch_ray(origin, direction, outward, other);
        return touch.usable && std::abs(touch.distance) < kMaxElsewhere_m;
    });
}

Misfit misfit_of(std::span<const SilhouetteRays> views, std::span<const SurfaceTerm> terms,
                 std::span<const BodyCapsule> capsules) {
    Misfit misfit;
    std::array<int, kBodySegmentCount> rays{};
    int all = 0;
    for (const SurfaceTerm& term : terms) {
        if (term.ray < 0) continue;
        const double r = std::min(std::abs(term.residual), kMaxResidual_m);
        const int segment = capsules[term.capsule].segment;
        misfit.segment[segment] += r * r, ++rays[segment];
        misfit.all += r * r, ++all;
        misfit.touching[segment] +=
            r < kMaxTouching_m && !explained_elsewhere(views[term.camera].contour, term, capsules);
    }
    for (const SilhouetteRays& view : views)
        if (view.camera) {
            const auto without = static_cast<int>(view.border_without_contrast.size());
            misfit.all += without * kWithoutContrast_m * kWithoutContrast_m;
            all += without;
        }
    for (double& touching : misfit.touching) touching *= kRays / std::max(1, all);
    misfit.all = all > 0 ? misfit.all / all : kMaxResidual_m * kMaxResidual_m;
    for (int s = 0; s < kBodySegmentCount; ++s)
        misfit.segment[s] = (misfit.segment[s] + kSharedRays * misfit.all) / (rays[s] + kSharedRays);
    return misfit;
}

double data_variance(double curvature, const Misfit& misfit, const Weights& of) {
    return curvature * (of.data * misfit.all / kUsualMisfit_m2 +
                        kOfUndetermined * std::min(1.0, curvature / kUndetermined2));
}
// Where is_among_others(), the fit may put a limb anywhere in the other subject's silhouettes.
constexpr double kFartherAmongOthers = 2.5;

// m^2, of a joint's gross error.
double gross_variance(std::size_t joint, const Misfit& misfit, bool among_others, double added_log_odds) {
    const int segment = kJointSegment[joint];
    const JointError& error = kErrorOfJoint[joint];
    const double log_odds = error.gross_log_odds + added_log_odds +
                            kOfTouching * std::log1p(misfit.touching[segment]) +
                            kOfMisfit * std::sqrt(misfit.segment[segment]) / kOddsScale_m;
    const double std_m = error.gross_std_m * (among_others ? kFartherAmongOthers : 1);
    return std_m * std_m / (1 + std::exp(-log_odds));
}
double ambiguity_variance(double difference2, double own_misfit_m2, const Weights& of) {
    return difference2 * (of.ambiguity + of.doubtful_ambiguity * own_misfit_m2 / kUsualMisfit_m2);
}
double combined_std(double variance, double model_std) {
    return std::sqrt(variance + model_std * model_std);
}

// Mean squares of the differences to other postures, weighted by their probabilities.
struct Ambiguity {
    std::array<double, kJointNames.size()> joint_m2{};  // per axis
    std::array<double, kJointAngleNames.size()> angle_rad2{};
    std::array<double, kBodyDofCount> coordinate2{};
};

Ambiguity ambiguity(const BodyModel& model, const BodyPosture& posture, const PosedBody& posed,
                    std::span<const WeightedPosture> others) {
    Ambiguity result;
    const auto angles = joint_angles(posed.joints_in_world);
    const BodyCoordinates coordinates = coordinates_from_posture(posture);
    for (const WeightedPosture& other : others) {
        if (other.probability < kMinProbability) continue;
        const PosedBody there = model.forward(other.posture);
        for (std::size_t j = 0; j < result.joint_m2.size(); ++j) {
            const Vec3 d = there.joints_in_world[j] - posed.joints_in_world[j];
            result.joint_m2[j] += other.probability * dot(d, d) / 3;
        }
        const auto other_angles = joint_angles(there.joints_in_world);
        for (std::size_t k = 0; k < angles.size(); ++k) {
            const double d = std::remainder(other_angles[k] - angles[k], 2 * std::numbers::pi);
            if (std::isfinite(d)) result.angle_rad2[k] += other.probability * d * d;
        }
        const BodyCoordinates other_coordinates = coordinates_from_posture(other.posture);
        for (int k = 0; k < kBodyDofCount; ++k) {
            double d = other_coordinates[k] - coordinates[k];
            if (!is_position(k)) d = std::remainder(d, 2 * std::numbers::pi);
            result.coordinate2[k] += other.probability * d * d;
        }
    }
    return result;
}

using SupportSets = std::array<CameraSet, kBodySegmentCount>;
using JointJacobian = Eigen::Matrix<double, 3 * kJointNames.size(), kBodyDofCount>;
using AngleByPosition = Eigen::Matrix<double, kJointAngleNames.size(), 3 * kJointNames.size()>;
using AngleByStep = Eigen::Matrix<double, kJointAngleNames.size(), kBodyDofCount>;

// d joint positions / d step.
JointJacobian joint_jacobian(const BodyModel& model, const PosedBody& posed) {
    const auto frames = model.dof_frames(posed);
    JointJacobian jacobian;
    for (std::size_t j = 0; j < kJointNames.size(); ++j) {
        const auto columns = BodyModel::point_jacobian(frames, kJointSegment[j], posed.joints_in_world[j]);
        for (int k = 0; k < kBodyDofCount; ++k)
            jacobian.block<3, 1>(3 * static_cast<int>(j), k) << columns[k].x, columns[k].y, columns[k].z;
    }
    return jacobian;
}

// d angles / d joint positions, by central differences; 0 where an angle is undefined.
AngleByPosition angle_derivatives(const PosedBody& posed) {
    constexpr double kStep_m = 1e-5;
    AngleByPosition by_position;
    for (int p = 0; p < by_position.cols(); ++p) {
        auto moved = posed.joints_in_world;
        double Vec3::*const axis = p % 3 == 0 ? &Vec3::x : p % 3 == 1 ? &Vec3::y : &Vec3::z;
        moved[p / 3].*axis += kStep_m;
        const auto forth = joint_angles(moved);
        moved[p / 3].*axis -= 2 * kStep_m;
        const auto back = joint_angles(moved);
        for (std::size_t k = 0; k < forth.size(); ++k) {
            const double difference = forth[k] - back[k];
            by_position(static_cast<int>(k), p) = std::isfinite(difference) ? difference / (2 * kStep_m) : 0;
        }
    }
    return by_position;
}

std::string visible_in(std::string_view what, int count, int cameras) {
    return fmt::format("{} {} of {} cameras", what, count ? "visible in one" : "not visible in any", cameras);
}

// What a posture's uncertainty is judged by.
struct Evidence {
    bool beside_others;  // in any view
    Matrix covariance;   // of a step, without motion prior
    SupportSets support;
    Ambiguity others;
    Misfit misfit;
    std::array<double, kJointNames.size()> gross_m2{};   // per axis, of gross errors
    std::array<double, kBodySegmentCount> gross_rad2{};  // of a segment's rotation

    // That determine a value. One camera shows no depth: beside others, a fifth of such joints are far off.
    int min_cameras() const { return beside_others ? 2 : 1; }
};

// The joint from which one hangs; of the pelvis and its neighbours the joint itself.
std::size_t joint_above(std::size_t joint) {
    const int segment = kJointSegment[joint], parent = kBodyParent[segment];
    if (parent <= kPelvis) return joint;
    return origin_joint(segment) == joint ? origin_joint(parent) : origin_joint(segment);
}

// Where a limb is lost, so is what hangs on it: a foot may touch its rays beside a folded leg. A gross error
// of either end turns a segment.
void judge_gross_errors(std::span<const SilhouetteRays> views, const PosedBody& posed, double added_log_odds,
                        Evidence& evidence) {
    for (std::size_t j = 0; j < evidence.gross_m2.size(); ++j) {
        evidence.gross_m2[j] = gross_variance(
            j, evidence.misfit, is_among_others(views, posed.joints_in_world[j]), added_log_odds);
        if (const std::size_t above = joint_above(j); above != j)
            evidence.gross_m2[j] += evidence.gross_m2[above];
    }
    for (int s = 1; s < kBodySegmentCount; ++s) {
        const std::size_t start = origin_joint(s);
        const auto end = static_cast<std::size_t>(kSegmentFarJoint[s]);
        const Vec3 along = posed.joints_in_world[end] - posed.joints_in_world[start];
        evidence.gross_rad2[s] =
            std::min((evidence.gross_m2[start] + evidence.gross_m2[end]) / dot(along, along),
                     kRotationStd_rad * kRotationStd_rad);
    }
}

void judge_joints(const JointJacobian& jacobian, const Evidence& of, int cameras,
                  const EstimateOptions& options, BodyPose& out) {
    for (std::size_t j = 0; j < kJointNames.size(); ++j) {
        const int segment = kJointSegment[j];
        const auto rows = jacobian.middleRows<3>(3 * static_cast<int>(j));
        const JointError& error = kErrorOfJoint[j];
        JointEstimate& joint = out.joints[j];
        const int parent = kBodyParent[segment];
        const double own = of.misfit.segment[segment], above = of.misfit.segment[std::max(parent, 0)];
        const double usual =
            data_variance((rows * of.covariance * rows.transpose()).trace() / 3, of.misfit, kOfJoints) +
            error.of_own_misfit * own + kOfAllMisfit * of.misfit.all +
            kOfParentMisfit * above * above / kParentMisfit_m2;
        joint.std_m =
            combined_std(usual + ambiguity_variance(of.others.joint_m2[j], own, kOfJoints) + of.gross_m2[j],
                         std::hypot(error.model_std_m, error.of_other_body * options.body_std_m));
        const CameraSet set = parent >= 0 ? of.support[segment] | of.support[parent] : of.support[segment];
        joint.camera_count = static_cast<int>(set.count());
        joint.withheld_reason.clear();
        if (joint.camera_count < of.min_cameras())
            joint.withheld_reason = visible_in("joint", joint.camera_count, cameras);
        else if (joint.std_m > options.max_joint_std_m)
            joint.withheld_reason = fmt::format("position uncertain (std {:.0f} mm)", 1000 * joint.std_m);
    }
}

void judge_angles(const AngleByStep& by_step, const Evidence& of, int cameras, const EstimateOptions& options,
                  BodyPose& out) {
    for (std::size_t k = 0; k < out.angles.size(); ++k) {
        AngleEstimate& angle = out.angles[k];
        const SegmentPair pair = kAngleSegments[k];
        const auto row = by_step.row(static_cast<int>(k));
        angle.std_rad = combined_std(
            data_variance((row * of.covariance * row.transpose()).value(), of.misfit, kOfAngles) +
                ambiguity_variance(of.others.angle_rad2[k], of.misfit.segment[pair.second], kOfAngles) +
                of.gross_rad2[pair.first] + of.gross_rad2[pair.second],
            std::hypot(kModelAngleStd[k], options.body_std_m / kLimb_m));
        angle.velocity_rad_per_s = kNaN;
        angle.camera_count = static_cast<int>((of.support[pair.first] | of.support[pair.second]).count());
        angle.withheld_reason.clear();
        const int hidden = of.support[pair.first].none() ? pair.first : pair.second;
        const int count = of.support[hidden].none() ? 0 : angle.camera_count;
        if (count < of.min_cameras())
            angle.withheld_reason = visible_in(kBodySegmentNames[hidden], count, cameras);
        else if (angle.std_rad > options.max_angle_std_rad)
            angle.withheld_reason = fmt::format("angle uncertain (std {:.0f} deg)", angle.std_rad / kDegree);
    }
}

// Of a ball joint: through the derivatives of its angles by its rotation vector.
void judge_coordinates(const BodyPosture& posture, const Evidence& of, const EstimateOptions& options,
                       BodyPose& out) {
    const Matrix& covariance = of.covariance;
    const auto variance = [&of](int dof, double curvature, int segment) {
        return data_variance(curvature, of.misfit, kOfAngles) +
               ambiguity_variance(of.others.coordinate2[dof], of.misfit.segment[segment], kOfAngles);
    };
    constexpr std::size_t kRoot = *joint_index("root");
    out.coordinate_velocity.fill(kNaN);
    for (int k = 0; k < 3; ++k)
        out.coordinate_std[k] = combined_std(
            variance(k, covariance(k, k), kPelvis) + kOfRootMisfit * of.misfit.all + of.gross_m2[kRoot],
            std::hypot(kErrorOfJoint[kRoot].model_std_m, options.body_std_m));
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const int first = kSegmentDof[s];
        const double rotation_std = std::hypot(model_rotation_std(s), options.body_std_m / kLimb_m);
        // Against the parent: an error of either.
        const double gross = of.gross_rad2[s] + (s > 0 ? of.gross_rad2[kBodyParent[s]] : 0);
        if (kSegmentDofCount[s] == 1) {
            out.coordinate_std[first] =
                combined_std(variance(first, covariance(first, first), s) + gross, rotation_std);
            continue;
        }
        const Mat3 rates = euler_rates(s, posture.parent_from_segment[s]);
        Eigen::Matrix3d by_rotation;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) by_rotation(r, c) = rates(r, c);
        const Eigen::Matrix3d rotated =
            by_rotation * covariance.block<3, 3>(first, first) * by_rotation.transpose();
        for (int k = 0; k < 3; ++k)
            out.coordinate_std[first + k] =
                combined_std(variance(first + k, rotated(k, k), s) + gross, rotation_std);
    }
}

}  // namespace

void judge_posture(const BodyModel& model, const BodyPosture& posture, const Linearisation& data,
                   std::span<const SilhouetteRays> views, std::span<const SurfaceTerm> terms,
                   std::span<const BodyCapsule> capsules, std::span<const WeightedPosture> others,
                   int cameras, const EstimateOptions& options, BodyPose& out) {
    Matrix information = data.hessian;
    for (int k = 0; k < kBodyDofCount; ++k)
        information(k, k) +=
            k < 3 ? 1 / (kRoomStd_m * kRoomStd_m) : 1 / (kRotationStd_rad * kRotationStd_rad);
    const PosedBody posed = model.forward(posture);
    Evidence evidence{.beside_others = shows_others(views),
                      .covariance = information.llt().solve(Matrix::Identity()),
                      .support = supporting_cameras(terms, capsules),
                      .others = ambiguity(model, posture, posed, others),
                      .misfit = misfit_of(views, terms, capsules)};
    judge_gross_errors(views, posed, options.gross_log_odds, evidence);
    const JointJacobian jacobian = joint_jacobian(model, posed);
    judge_joints(jacobian, evidence, cameras, options, out);
    judge_angles(angle_derivatives(posed) * jacobian, evidence, cameras, options, out);
    judge_coordinates(posture, evidence, options, out);
    const auto withheld =
        static_cast<double>(std::ranges::count_if(out.joints, std::not_fn(&JointEstimate::measured)));
    if (evidence.beside_others && withheld >= kMaxWithheld * static_cast<double>(out.joints.size()))
        withhold_limbs(out);
}

}  // namespace kinevox
