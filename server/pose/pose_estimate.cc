#include "server/pose/pose_estimate.h"

#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>

#include <Eigen/Cholesky>
#include <fmt/format.h>

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kDegree = 0.017453292519943295;
// What is known without any picture, so that the covariance is finite: the room and a turn.
constexpr double kRoomStd_m = 2, kTurnStd = 1.5;
constexpr double kLeastHipFlexion = 5 * kDegree;   // for a ratio
constexpr int kTermsOfSupport = 4;                 // residuals of a camera on a segment that make it a support
constexpr int kMostCameras = 64;

using Matrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
using Vector = Eigen::Matrix<double, kBodyDofCount, 1>;
using CameraSet = std::bitset<kMostCameras>;

// The segments that an angle turns against each other, by kJointAngleNames.
struct SegmentPair {
    int first, second;
};
constexpr std::array<SegmentPair, kJointAngleNames.size()> kAngleSegments{{
    {kThighL, kShankL}, {kThighR, kShankR}, {kUpperArmL, kForearmL}, {kUpperArmR, kForearmR}, {kPelvis, kThighL},
    {kPelvis, kThighR}, {kPelvis, kThighL}, {kPelvis, kThighR}, {kThorax, kUpperArmL}, {kThorax, kUpperArmR},
    {kPelvis, kThorax}}};

std::array<CameraSet, kBodySegmentCount> supporting_cameras(std::span<const SurfaceTerm> terms,
                                                            std::span<const BodyCapsule> capsules) {
    std::array<std::array<int, kMostCameras>, kBodySegmentCount> counts{};
    for (const SurfaceTerm& term : terms)
        if (term.camera >= 0 && term.camera < kMostCameras) ++counts[capsules[term.capsule].segment][term.camera];
    std::array<CameraSet, kBodySegmentCount> sets;
    for (int s = 0; s < kBodySegmentCount; ++s)
        for (int c = 0; c < kMostCameras; ++c) sets[s][c] = counts[s][c] >= kTermsOfSupport;
    return sets;
}

double ratio(double knee, double hip) { return std::abs(hip) < kLeastHipFlexion ? kNaN : knee / hip; }

}  // namespace

void describe_posture(const BodyModel& model, const BodyPosture& posture, BodyPose& out) {
    const PosedBody posed = model.forward(posture);
    for (std::size_t j = 0; j < out.joints.size(); ++j)
        out.joints[j].in_world = out.joints[j].measured() ? posed.joints_in_world[j] : Vec3{kNaN, kNaN, kNaN};
    const auto angles = joint_angles(posed.joints_in_world);
    for (std::size_t k = 0; k < out.angles.size(); ++k)
        out.angles[k].value_rad = out.angles[k].measured() ? angles[k] : kNaN;
    out.coordinates = coordinates_from_posture(posture);
    for (int s = 0; s < kBodySegmentCount; ++s) {
        out.world_from_segment[s] = quaternion_from_rotation(posed.world_from_segment[s].rotation);
        out.parent_from_segment[s] = quaternion_from_rotation(posture.parent_from_segment[s]);
    }
    out.ratios.knee_hip_l = ratio(out.angles[0].value_rad, out.angles[4].value_rad);
    out.ratios.knee_hip_r = ratio(out.angles[1].value_rad, out.angles[5].value_rad);
}

void judge_posture(const BodyModel& model, const BodyPosture& posture, const Linearisation& data,
                   std::span<const SurfaceTerm> terms, std::span<const BodyCapsule> capsules, int cameras,
                   const EstimateOptions& options, BodyPose& out) {
    Matrix information = data.hessian;
    for (int k = 0; k < kBodyDofCount; ++k)
        information(k, k) += k < 3 ? 1 / (kRoomStd_m * kRoomStd_m) : 1 / (kTurnStd * kTurnStd);
    const Matrix covariance = information.llt().solve(Matrix::Identity());

    const auto support = supporting_cameras(terms, capsules);
    const PosedBody posed = model.forward(posture);
    const auto frames = model.dof_frames(posed);
    Eigen::Matrix<double, 3 * kJointNames.size(), kBodyDofCount> jacobian;
    for (std::size_t j = 0; j < kJointNames.size(); ++j) {
        const int segment = BodyModel::joint_segment(static_cast<int>(j));
        const auto columns = BodyModel::point_jacobian(frames, segment, posed.joints_in_world[j]);
        for (int k = 0; k < kBodyDofCount; ++k)
            jacobian.block<3, 1>(3 * static_cast<int>(j), k) << columns[k].x, columns[k].y, columns[k].z;
        const auto rows = jacobian.middleRows<3>(3 * static_cast<int>(j));
        JointEstimate& joint = out.joints[j];
        joint.std_m = std::sqrt((rows * covariance * rows.transpose()).trace() / 3);
        const int parent = kBodyParent[segment];
        const CameraSet set = parent >= 0 ? support[segment] | support[parent] : support[segment];
        joint.cameras = static_cast<int>(set.count());
        joint.withheld.clear();
        if (joint.cameras == 0)
            joint.withheld = fmt::format("none of {} cameras shows the segments at it", cameras);
        else if (joint.std_m > options.most_joint_std_m)
            joint.withheld = fmt::format("the silhouettes leave its place open by {:.0f} mm", 1000 * joint.std_m);
    }

    // Angles are functions of the joints' positions: their derivative by differences, the joints' by the Jacobian.
    constexpr double kStep_m = 1e-5;
    Eigen::Matrix<double, kJointAngleNames.size(), 3 * kJointNames.size()> by_position;
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
    const Eigen::Matrix<double, kJointAngleNames.size(), kBodyDofCount> by_step = by_position * jacobian;
    for (std::size_t k = 0; k < out.angles.size(); ++k) {
        AngleEstimate& angle = out.angles[k];
        const auto row = by_step.row(static_cast<int>(k));
        angle.std_rad = std::sqrt((row * covariance * row.transpose()).value());
        angle.velocity_rad_s = kNaN;
        const SegmentPair pair = kAngleSegments[k];
        angle.cameras = static_cast<int>((support[pair.first] | support[pair.second]).count());
        angle.withheld.clear();
        if (support[pair.first].none() || support[pair.second].none())
            angle.withheld = fmt::format("none of {} cameras shows {}", cameras,
                                         kBodySegmentNames[support[pair.first].none() ? pair.first : pair.second]);
        else if (angle.std_rad > options.most_angle_std_rad)
            angle.withheld = fmt::format("the silhouettes leave it open by {:.0f} deg", angle.std_rad / kDegree);
    }

    // Of the coordinates: those of a ball joint through the rates of its angles.
    for (int k = 0; k < 3; ++k) out.coordinate_std[k] = std::sqrt(covariance(k, k));
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const int first = kSegmentDof[s];
        if (kSegmentDofCount[s] == 1) {
            out.coordinate_std[first] = std::sqrt(covariance(first, first));
            continue;
        }
        const Mat3 rates = euler_rates(s, posture.parent_from_segment[s]);
        Eigen::Matrix3d by_turn;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) by_turn(r, c) = rates(r, c);
        const Eigen::Matrix3d turned = by_turn * covariance.block<3, 3>(first, first) * by_turn.transpose();
        for (int k = 0; k < 3; ++k) out.coordinate_std[first + k] = std::sqrt(turned(k, k));
    }
}

void set_velocities(const BodyPose& before, BodyPose& pose) {
    const double seconds = 1e-9 * static_cast<double>(pose.capture_time_ns - before.capture_time_ns);
    if (!(seconds > 0)) return;
    for (std::size_t k = 0; k < pose.angles.size(); ++k)
        pose.angles[k].velocity_rad_s = (pose.angles[k].value_rad - before.angles[k].value_rad) / seconds;
}

}  // namespace kinevox
