#include "common/body_pose.h"

#include <cmath>

namespace kinevox {
// Shepperd's method: the largest of the four is computed from the diagonal, the others from it.
Quaternion quaternion_from_rotation(const Mat3& r) {
    const double trace = r(0, 0) + r(1, 1) + r(2, 2);
    Quaternion q;
    if (trace > 0) {
        const double s = 2 * std::sqrt(1 + trace);
        q = {s / 4, (r(2, 1) - r(1, 2)) / s, (r(0, 2) - r(2, 0)) / s, (r(1, 0) - r(0, 1)) / s};
    } else if (r(0, 0) > r(1, 1) && r(0, 0) > r(2, 2)) {
        const double s = 2 * std::sqrt(1 + r(0, 0) - r(1, 1) - r(2, 2));
        q = {(r(2, 1) - r(1, 2)) / s, s / 4, (r(0, 1) + r(1, 0)) / s, (r(0, 2) + r(2, 0)) / s};
    } else if (r(1, 1) > r(2, 2)) {
        const double s = 2 * std::sqrt(1 + r(1, 1) - r(0, 0) - r(2, 2));
        q = {(r(0, 2) - r(2, 0)) / s, (r(0, 1) + r(1, 0)) / s, s / 4, (r(1, 2) + r(2, 1)) / s};
    } else {
        const double s = 2 * std::sqrt(1 + r(2, 2) - r(0, 0) - r(1, 1));
        q = {(r(1, 0) - r(0, 1)) / s, (r(0, 2) + r(2, 0)) / s, (r(1, 2) + r(2, 1)) / s, s / 4};
    }
    if (q.w < 0) q = {-q.w, -q.x, -q.y, -q.z};
    return q;
}

const std::string& coordinate_withheld_reason(const BodyPose& pose, int dof) {
    int segment = kPelvis;
    for (int s = 0; s < kBodySegmentCount; ++s)
        if (dof >= kSegmentDof[s] && dof < kSegmentDof[s] + kSegmentDofCount[s]) segment = s;
    return pose.joints[static_cast<std::size_t>(kSegmentFarJoint[segment])].withheld_reason;
}

}  // namespace kinevox
