#include <cmath>

#include "common/body_table.h"
#include "common/geometry.h"
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
    out.set_camera_count(joint.camera_count);
    out.set_withheld_reason(joint.withheld_reason);
    if (!joint.measured()) return out;
    *out.mutable_position_in_world() = to_proto(joint.in_world);
    out.set_std_m(joint.std_m);
    return out;
}

v1::AngleEstimate to_proto(const AngleEstimate& angle, std::string_view name) {
    v1::AngleEstimate out;
    out.set_name(std::string(name));
    out.set_camera_count(angle.camera_count);
    out.set_withheld_reason(angle.withheld_reason);
    if (!angle.measured()) return out;
    out.set_value_deg(degrees(angle.value_rad));
    out.set_std_deg(degrees(angle.std_rad));
    if (std::isfinite(angle.velocity_rad_per_s))
        out.set_velocity_deg_per_s(degrees(angle.velocity_rad_per_s));
    return out;
}

v1::CoordinateEstimate rotation_to_proto(const BodyPose& pose, int dof) {
    v1::CoordinateEstimate out;
    out.set_name(std::string(kBodyDofs[dof].name));
    out.set_withheld_reason(coordinate_withheld_reason(pose, dof));
    if (!out.withheld_reason().empty()) return out;
    out.set_value_deg(degrees(pose.coordinates[dof]));
    out.set_std_deg(degrees(pose.coordinate_std[dof]));
    if (std::isfinite(pose.coordinate_velocity[dof]))
        out.set_velocity_deg_per_s(degrees(pose.coordinate_velocity[dof]));
    return out;
}

v1::TranslationEstimate translation_to_proto(const BodyPose& pose, int dof) {
    v1::TranslationEstimate out;
    out.set_name(std::string(kBodyDofs[dof].name));
    out.set_withheld_reason(coordinate_withheld_reason(pose, dof));
    if (!out.withheld_reason().empty()) return out;
    out.set_value_m(pose.coordinates[dof]);
    out.set_std_m(pose.coordinate_std[dof]);
    if (std::isfinite(pose.coordinate_velocity[dof])) out.set_velocity_m_per_s(pose.coordinate_velocity[dof]);
    return out;
}

v1::SegmentRatios to_proto(const SegmentRatios& ratios) {
    v1::SegmentRatios out;
    out.set_thigh_length_ratio(ratios.thigh_length_ratio);
    out.set_shank_length_ratio(ratios.shank_length_ratio);
    out.set_upper_arm_length_ratio(ratios.upper_arm_length_ratio);
    out.set_forearm_length_ratio(ratios.forearm_length_ratio);
    if (std::isfinite(ratios.knee_hip_flexion_ratio_l))
        out.set_knee_hip_flexion_ratio_l(ratios.knee_hip_flexion_ratio_l);
    if (std::isfinite(ratios.knee_hip_flexion_ratio_r))
        out.set_knee_hip_flexion_ratio_r(ratios.knee_hip_flexion_ratio_r);
    return out;
}

}  // namespace

v1::Pose to_proto(const BodyPose& pose) {
    v1::Pose out;
    for (std::size_t i = 0; i < kJointNames.size(); ++i)
        *out.add_joints() = to_proto(pose.joints[i], kJointNames[i]);
    for (std::size_t i = 0; i < kJointAngleNames.size(); ++i)
        *out.add_angles() = to_proto(pose.angles[i], kJointAngleNames[i]);
    for (int dof = 0; dof < kBodyDofCount; ++dof) {
        if (is_position(dof))
            *out.add_translations() = translation_to_proto(pose, dof);
        else
            *out.add_coordinates() = rotation_to_proto(pose, dof);
    }
    for (std::size_t i = 0; i < kBodySegmentNames.size(); ++i) {
        v1::SegmentOrientation* segment = out.add_segment_orientations();
        segment->set_name(std::string(kBodySegmentNames[i]));
        *segment->mutable_world_from_segment() = to_proto(pose.world_from_segment[i]);
        *segment->mutable_parent_from_segment() = to_proto(pose.parent_from_segment[i]);
    }
    *out.mutable_ratios() = to_proto(pose.ratios);
    out.set_contour_residual_rms_m(pose.contour_residual_rms_m);
    out.set_filtered(pose.filtered);
    return out;
}

}  // namespace kinevox
