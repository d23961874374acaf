// What was measured of a body at one instant: joints, angles and how far they can be trusted.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/geometry.h"
#include "common/joint_angles.h"
#include "common/skeleton.h"

namespace kinevox {

// Unit, w first, w >= 0.
struct Quaternion {
    double w = 1, x = 0, y = 0, z = 0;
    bool operator==(const Quaternion&) const = default;
};
Quaternion quaternion_from_rotation(const Mat3& rotation);

inline constexpr int kPoseCoordinateCount = 32;
inline constexpr int kPoseSegmentCount = 15;

struct JointEstimate {
    Vec3 in_world;         // m; NaN where withheld
    double std_m = 0;      // of one axis
    int cameras = 0;       // whose silhouettes determine it
    std::string withheld;  // why there is no value; empty: there is one
    bool measured() const { return withheld.empty(); }
};

struct AngleEstimate {
    double value_rad = 0;  // NaN where withheld
    double std_rad = 0;
    double velocity_rad_s = 0;  // NaN without a frame before
    int cameras = 0;
    std::string withheld;
    bool measured() const { return withheld.empty(); }
};

// Of the subject's body, not of this frame; left/right is 1 for a symmetric body.
struct SegmentRatios {
    double thigh_left_right = 1, shank_left_right = 1, upper_arm_left_right = 1, forearm_left_right = 1;
    // Movement: knee flexion over hip flexion of a side, NaN where the hip is flexed by less than 5 deg.
    double knee_hip_l = 0, knee_hip_r = 0;
};

struct BodyPose {
    std::uint32_t subject_id = 0;
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    std::array<JointEstimate, kJointNames.size()> joints;       // in the order of kJointNames
    std::array<AngleEstimate, kJointAngleNames.size()> angles;  // in the order of kJointAngleNames
    std::array<double, kPoseCoordinateCount>
        coordinates{};  // m, rad; names: server/pose/body_model.h, kBodyDofs
    std::array<double, kPoseCoordinateCount> coordinate_std{};
    // Of the segments in the order of kBodySegmentNames; at identity x is forward, y left, z up.
    std::array<Quaternion, kPoseSegmentCount> world_from_segment;
    std::array<Quaternion, kPoseSegmentCount> parent_from_segment;
    SegmentRatios ratios;
    double contour_rms_m = 0;  // of the silhouettes' contours around the body's outline
    bool filtered = false;     // smoothed over time

    // Positions in the order of kJointNames, NaN where withheld.
    std::array<Vec3, kJointNames.size()> joint_positions() const;
};

// By name; nothing for a name that there is not.
std::optional<std::size_t> joint_index(std::string_view name);
std::optional<std::size_t> angle_index(std::string_view name);

}  // namespace kinevox
