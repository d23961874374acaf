// The measured body at one instant: joints, angles, coordinates and their uncertainty.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox {

// Unit, w first, w >= 0.
struct Quaternion {
    double w = 1, x = 0, y = 0, z = 0;
    bool operator==(const Quaternion&) const = default;
};
Quaternion quaternion_from_rotation(const Mat3& rotation);

struct JointEstimate {
    Vec3 in_world;                // m; NaN where withheld
    double std_m = 0;             // per axis
    int camera_count = 0;         // cameras whose silhouettes determine it
    std::string withheld_reason;  // empty: measured
    bool measured() const { return withheld_reason.empty(); }
};

struct AngleEstimate {
    double value_rad = 0;  // NaN where withheld
    double std_rad = 0;
    double velocity_rad_per_s = 0;  // NaN in the first frame and where withheld
    int camera_count = 0;
    std::string withheld_reason;
    bool measured() const { return withheld_reason.empty(); }
};

struct SegmentRatios {
    // Of the subject's body, not of this frame: left over right, 1 for a symmetric body.
    double thigh_length_ratio = 1, shank_length_ratio = 1, upper_arm_length_ratio = 1,
           forearm_length_ratio = 1;
    // Of this frame: knee flexion over hip flexion, NaN where the hip is flexed by less than 5 deg.
    double knee_hip_flexion_ratio_l = 0, knee_hip_flexion_ratio_r = 0;
};

struct BodyPose {
    std::uint32_t subject_id = 0;
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    std::array<JointEstimate, kJointNames.size()> joints;       // in the order of kJointNames
    std::array<AngleEstimate, kJointAngleNames.size()> angles;  // in the order of kJointAngleNames
    // Model coordinates in the order of kBodyDofs, m and rad; coordinate_withheld_reason() says which are
    // measured.
    std::array<double, kBodyDofCount> coordinates{};
    std::array<double, kBodyDofCount> coordinate_std{};
    // m/s and rad/s; NaN in the first frame.
    std::array<double, kBodyDofCount> coordinate_velocity{};
    // Segments in the order of kBodySegmentNames; at identity x is forward, y left, z up.
    std::array<Quaternion, kBodySegmentCount> world_from_segment;
    std::array<Quaternion, kBodySegmentCount> parent_from_segment;
    SegmentRatios ratios;
    double contour_residual_rms_m = 0;  // of the silhouettes' contours against the fitted body
    bool filtered = false;              // smoothed over time
};

// Why a coordinate of kBodyDofs has no value; empty: measured. It is withheld with the joint at its segment's
// far end, the root's with the root.
const std::string& coordinate_withheld_reason(const BodyPose& pose, int dof);

// By name; nullopt for an unknown one.
template <std::size_t kCount>
constexpr std::optional<std::size_t> index_of(const std::array<std::string_view, kCount>& names,
                                              std::string_view name) {
    for (std::size_t i = 0; i < kCount; ++i)
        if (names[i] == name) return i;
    return std::nullopt;
}
constexpr std::optional<std::size_t> joint_index(std::string_view name) {
    return index_of(kJointNames, name);
}
constexpr std::optional<std::size_t> angle_index(std::string_view name) {
    return index_of(kJointAngleNames, name);
}

// Geometric angles: from joint positions alone; angles.csv holds them and clients read them. Model
// coordinates (server/pose/body_model.h) have other names and other definitions. Definitions: lat =
// unit(hip_l - hip_r), mh = midpoint of the hips, up = unit of the component of (sacroiliac - mh) orthogonal
// to lat, fwd = lat x up, ms = midpoint of the shoulders.
//   knee_flexion_geometric       between (knee - hip) and (ankle - knee), 0 straight; elbow_flexion alike
//   hip_flexion_geometric        atan2(u . fwd, -u . up), u = unit(knee - hip): positive in front
//   hip_abduction_geometric      asin(u . lat), sign inverted for the right leg: positive away from the
//                                midline (the coordinate hip_adduction is positive towards it)
//   shoulder_elevation_geometric between (elbow - shoulder) and (mh - ms): 0 with the arm hanging
//   trunk_lean_geometric         between (skullbase - root) and the vertical
// World positions in the order of kJointNames, metres, z up. Radians, in the order of kJointAngleNames; NaN
// where a joint that an angle needs is NaN or where two joints that span it coincide.
std::array<double, kJointAngleNames.size()> joint_angles(
    std::span<const Vec3, kJointNames.size()> joints_in_world);

}  // namespace kinevox
