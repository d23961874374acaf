#include "server/pose/pose_estimate.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <bitset>
#include <cmath>
#include <limits>

#include "common/degrees.h"

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
// What is known without any picture, so that the covariance is finite: the room and a turn.
constexpr double kRoomStd_m = 2, kTurnStd = 1.5;
constexpr double kMinHipFlexion = 5 * kDegree;  // for a ratio
constexpr int kTermsOfSupport = 4;              // residuals of a camera on a segment that make it a support
constexpr int kMaxCameras = 64;

using Matrix = Eigen::Matrix<double, kBodyDofCount, kBodyDofCount>;
using Vector = Eigen::Matrix<double, kBodyDofCount, 1>;
using CameraSet = std::bitset<kMaxCameras>;

// The segments that an angle turns against each other, by kJointAngleNames.
struct SegmentPair {
    int first, second;
};
constexpr std::array<SegmentPair, kJointAngleNames.size()> kAngleSegments{{{kThighL, kShankL},
                                                                           {kThighR, kShankR},
                                                                           {kUpperArmL, kForearmL},
                                                                           {kUpperArmR, kForearmR},
                                                                           {kPelvis, kThighL},
                                                                           {kPelvis, kThighR},
                                                                           {kPelvis, kThighL},
                                                                           {kPelvis, kThighR},
                                                                           {kThorax, kUpperArmL},
                                                                           {kThorax, kUpperArmR},
                                                                           {kPelvis, kThorax}}};

std::array<CameraSet, kBodySegmentCount> supporting_cameras(std::span<const SurfaceTerm> terms,
                                                            std::span<const BodyCapsule> capsules) {
    std::array<std::array<int, kMaxCameras>, kBodySegmentCount> counts{};
    for (const SurfaceTerm& term : terms)
        if (term.camera >= 0 && term.camera < kMaxCameras)
            ++counts[capsules[term.capsule].segment][term.camera];
    std::array<CameraSet, kBodySegmentCount> sets;
    for (int s = 0; s < kBodySegmentCount; ++s)
        for (int c = 0; c < kMaxCameras; ++c) sets[s][c] = counts[s][c] >= kTermsOfSupport;
    return sets;
}

// What the surface errs by, whatever the number of cameras: a person is only nearly a body of capsules, and
// errs alike in every frame. Measured as what must be added (squared) to the silhouettes' part so that 68 %
// of the errors lie within: tests/accuracy/pose_sigma.py, on the shared sequences and on the studio's, none
// of which the fit was given truth of. Joints, m, of one axis, left and right alike.
double model_std_m(std::string_view joint) {
    struct Entry {
        std::string_view name;
        double std_m;
    };
    constexpr Entry kEntries[] = {{"root", 0.011},     {"sacroiliac", 0.018}, {"skullbase", 0.005},
                                  {"head_top", 0.010}, {"shoulder", 0.012},   {"elbow", 0.012},
                                  {"wrist", 0.015},    {"hand", 0.014},       {"hip", 0.019},
                                  {"knee", 0.009},     {"ankle", 0.007},      {"toe", 0.012}};
    for (const Entry& entry : kEntries)
        if (joint.starts_with(entry.name)) return entry.std_m;
    return 0;
}
// Angles in the order of kJointAngleNames, rad: each side's knee, elbow, hip flexion and abduction, shoulder,
// and the trunk.
constexpr std::array<double, kJointAngleNames.size()> kModelAngleStd{
    6.9 * kDegree, 6.9 * kDegree, 5.0 * kDegree, 5.0 * kDegree, 3.5 * kDegree, 3.5 * kDegree,
    2.5 * kDegree, 2.5 * kDegree, 3.3 * kDegree, 3.3 * kDegree, 2.0 * kDegree};
// A segment's turn against its parent, rad: that of the angle which the same joint gives, else (neck, ankle,
// wrist) of the far joint's place over the segment's length.
double model_turn_std(int segment) {
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
double both(double data_variance, double model_std) {
    return std::sqrt(data_variance + model_std * model_std);
}

double ratio(double knee, double hip) {
    return std::abs(hip) < kMinHipFlexion ? kNaN : knee / hip;
}

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
        joint.std_m = both((rows * covariance * rows.transpose()).trace() / 3, model_std_m(kJointNames[j]));
        const int parent = kBodyParent[segment];
        const CameraSet set = parent >= 0 ? support[segment] | support[parent] : support[segment];
        joint.cameras = static_cast<int>(set.count());
        joint.withheld.clear();
        if (joint.cameras == 0)
            joint.withheld = fmt::format("none of {} cameras shows the segments at it", cameras);
        else if (joint.std_m > options.max_joint_std_m)
            joint.withheld =
                fmt::format("the silhouettes leave its place open by {:.0f} mm", 1000 * joint.std_m);
    }

    // Angles are functions of the joints' positions: their derivative by differences, the joints' by the
    // Jacobian.
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
        angle.std_rad = both((row * covariance * row.transpose()).value(), kModelAngleStd[k]);
        angle.velocity_rad_s = kNaN;
        const SegmentPair pair = kAngleSegments[k];
        angle.cameras = static_cast<int>((support[pair.first] | support[pair.second]).count());
        angle.withheld.clear();
        if (support[pair.first].none() || support[pair.second].none())
            angle.withheld =
                fmt::format("none of {} cameras shows {}", cameras,
                            kBodySegmentNames[support[pair.first].none() ? pair.first : pair.second]);
        else if (angle.std_rad > options.max_angle_std_rad)
            angle.withheld =
                fmt::format("the silhouettes leave it open by {:.0f} deg", angle.std_rad / kDegree);
    }

    // Of the coordinates: those of a ball joint through the rates of its angles.
    for (int k = 0; k < 3; ++k) out.coordinate_std[k] = both(covariance(k, k), model_std_m("root"));
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const int first = kSegmentDof[s];
        if (kSegmentDofCount[s] == 1) {
            out.coordinate_std[first] = both(covariance(first, first), model_turn_std(s));
            continue;
        }
        const Mat3 rates = euler_rates(s, posture.parent_from_segment[s]);
        Eigen::Matrix3d by_turn;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) by_turn(r, c) = rates(r, c);
        const Eigen::Matrix3d turned = by_turn * covariance.block<3, 3>(first, first) * by_turn.transpose();
        for (int k = 0; k < 3; ++k) out.coordinate_std[first + k] = both(turned(k, k), model_turn_std(s));
    }
}

void set_velocities(const BodyPose& before, BodyPose& pose) {
    const double seconds = 1e-9 * static_cast<double>(pose.capture_time_ns - before.capture_time_ns);
    if (!(seconds > 0)) return;
    for (std::size_t k = 0; k < pose.angles.size(); ++k)
        pose.angles[k].velocity_rad_s = (pose.angles[k].value_rad - before.angles[k].value_rad) / seconds;
}

}  // namespace kinevox
