#include <cmath>

#include "common/body_pose.h"

namespace kinevox {
namespace {

// A name that kJointNames lacks does not compile.
constexpr std::size_t kRoot = *joint_index("root"), kSacroiliac = *joint_index("sacroiliac"),
                      kSkullbase = *joint_index("skullbase");
struct Limbs {
    std::size_t shoulder, elbow, wrist, hip, knee, ankle;
};
constexpr std::array<Limbs, 2> kLimbs{
    Limbs{*joint_index("shoulder_l"), *joint_index("elbow_l"), *joint_index("wrist_l"), *joint_index("hip_l"),
          *joint_index("knee_l"), *joint_index("ankle_l")},
    Limbs{*joint_index("shoulder_r"), *joint_index("elbow_r"), *joint_index("wrist_r"), *joint_index("hip_r"),
          *joint_index("knee_r"), *joint_index("ankle_r")}};

double angle_between(Vec3 a, Vec3 b) {
    const double across = norm(cross(a, b)), along = dot(a, b);
    if (across == 0 && along == 0) return std::nan("");  // one of them has no direction
    return std::atan2(across, along);
}

}  // namespace

std::array<double, kJointAngleNames.size()> joint_angles(std::span<const Vec3, kJointNames.size()> joints) {
    const Vec3 hip_l = joints[kLimbs[0].hip], hip_r = joints[kLimbs[1].hip];
    const Vec3 mid_hips = 0.5 * (hip_l + hip_r);
    const Vec3 mid_shoulders = 0.5 * (joints[kLimbs[0].shoulder] + joints[kLimbs[1].shoulder]);
    const Vec3 lat = normalized(hip_l - hip_r);
    const Vec3 spine = joints[kSacroiliac] - mid_hips;
    const Vec3 up = normalized(spine - dot(spine, lat) * lat), fwd = cross(lat, up);

    std::array<double, kJointAngleNames.size()> angles{};
    for (std::size_t side = 0; side < 2; ++side) {
        const Limbs& at = kLimbs[side];
        const Vec3 thigh = joints[at.knee] - joints[at.hip], shank = joints[at.ankle] - joints[at.knee];
        const Vec3 upper_arm = joints[at.elbow] - joints[at.shoulder],
                   forearm = joints[at.wrist] - joints[at.elbow];
        const Vec3 u = normalized(thigh);
        const double sideways = dot(u, lat) * (side == 0 ? 1.0 : -1.0);
        angles[0 + side] = angle_between(thigh, shank);
        angles[2 + side] = angle_between(upper_arm, forearm);
        angles[4 + side] = std::atan2(dot(u, fwd), -dot(u, up));
        angles[6 + side] = std::isnan(sideways) ? sideways : std::asin(std::clamp(sideways, -1.0, 1.0));
        angles[8 + side] = angle_between(upper_arm, mid_hips - mid_shoulders);
    }
    angles[10] = angle_between(joints[kSkullbase] - joints[kRoot], {0, 0, 1});
    return angles;
}

}  // namespace kinevox
