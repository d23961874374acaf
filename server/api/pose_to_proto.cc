#include <cmath>

#include "common/degrees.h"
#include "server/api/to_proto.h"
#include "server/pose/body_model.h"

namespace kinevox {
namespace {

v1::Quaternion to_proto(const Quaternion& q) {
    v1::Quaternion out;
    out.set_w(q.w);
    out.set_x(q.x);
    out.set_y(q.y);
    out.set_z(q.z);
    return out;
}

v1::JointEstimate to_proto(const JointEstimate& joint, std::string_view name) {
    v1::JointEstimate out;
    out.set_name(std::string(name));
    out.set_cameras(joint.cameras);
    out.set_withheld(joint.withheld);
    if (!joint.measured()) return out;
    *out.mutable_position_in_world() = to_proto(joint.in_world);
    out.set_std_m(joint.std_m);
    return out;
}

v1::AngleEstimate to_proto(const AngleEstimate& angle, std::string_view name) {
    v1::AngleEstimate out;
    out.set_name(std::string(name));
    out.set_cameras(angle.cameras);
    out.set_withheld(angle.withheld);
    if (!angle.measured()) return out;
    out.set_value_deg(degrees(angle.value_rad));
    out.set_std_deg(degrees(angle.std_rad));
    if (std::isfinite(angle.velocity_rad_s)) out.set_velocity_deg_s(degrees(angle.velocity_rad_s));
    return out;
}

v1::SegmentRatios to_proto(const SegmentRatios& ratios) {
    v1::SegmentRatios out;
    out.set_thigh_left_right(ratios.thigh_left_right);
    out.set_shank_left_right(ratios.shank_left_right);
    out.set_upper_arm_left_right(ratios.upper_arm_left_right);
    out.set_forearm_left_right(ratios.forearm_left_right);
    if (std::isfinite(ratios.knee_hip_l)) out.set_knee_hip_l(ratios.knee_hip_l);
    if (std::isfinite(ratios.knee_hip_r)) out.set_knee_hip_r(ratios.knee_hip_r);
    return out;
}

}  // namespace

v1::Pose to_proto(const BodyPose& pose) {
    v1::Pose out;
    out.set_subject_id(pose.subject_id);
    for (std::size_t i = 0; i < kJointNames.size(); ++i)
        *out.add_joints() = to_proto(pose.joints[i], kJointNames[i]);
    for (std::size_t i = 0; i < kJointAngleNames.size(); ++i)
        *out.add_angles() = to_proto(pose.angles[i], kJointAngleNames[i]);
    for (std::size_t i = 0; i < kBodySegmentNames.size(); ++i) {
        v1::SegmentOrientation* segment = out.add_segments();
        segment->set_name(std::string(kBodySegmentNames[i]));
        *segment->mutable_world_from_segment() = to_proto(pose.world_from_segment[i]);
        *segment->mutable_parent_from_segment() = to_proto(pose.parent_from_segment[i]);
    }
    *out.mutable_ratios() = to_proto(pose.ratios);
    out.set_contour_rms_m(pose.contour_rms_m);
    out.set_filtered(pose.filtered);
    return out;
}

}  // namespace kinevox
