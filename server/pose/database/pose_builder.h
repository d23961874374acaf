// Builds library poses in degrees, limb by limb.
#pragma once

#include <vector>

#include "common/geometry.h"
#include "server/pose/body_model.h"
#include "server/pose/database/pose_library.h"

namespace kinevox::database {

enum class Limb { kLeft, kRight };

// Signs: lean forward positive, abduction away from the midline positive.
struct PoseBuilder {
    BodyCoordinates q{};

    PoseBuilder& trunk(double pelvis_lean, double lumbar_flexion, double look_up = 0) {
        q[kDofRootRotation] = radians(-pelvis_lean);
        q[kDofSacroiliac] = radians(-lumbar_flexion);
        q[kDofSkullbase] = radians(look_up);
        return *this;
    }
    // Degrees, to the left positive.
    PoseBuilder& bend(double sideways, double rotation) {
        q[kDofSacroiliac + 1] = radians(-sideways);
        q[kDofSacroiliac + 2] = radians(rotation);
        return *this;
    }
    PoseBuilder& leg(Limb side, double hip_flexion, double knee, double ankle = 0, double hip_abduction = 2,
                     double external_rotation = 5) {
        const int hip = side == Limb::kLeft ? kDofHipL : kDofHipR;
        q[hip] = radians(hip_flexion), q[hip + 1] = radians(-hip_abduction),
        q[hip + 2] = radians(-external_rotation);
        q[hip + 3] = radians(knee), q[hip + 4] = radians(ankle);
        return *this;
    }
    PoseBuilder& arm(Limb side, double flexion, double abduction, double elbow,
                     double internal_rotation = 0) {
        const int shoulder = side == Limb::kLeft ? kDofShoulderL : kDofShoulderR;
        q[shoulder] = radians(flexion), q[shoulder + 1] = radians(-abduction),
        q[shoulder + 2] = radians(internal_rotation);
        q[shoulder + 3] = radians(elbow);
        return *this;
    }
    PoseBuilder& legs(double hip_flexion, double knee, double ankle = 0, double abduction = 2) {
        return leg(Limb::kLeft, hip_flexion, knee, ankle, abduction)
            .leg(Limb::kRight, hip_flexion, knee, ankle, abduction);
    }
    PoseBuilder& arms(double flexion, double abduction, double elbow, double internal_rotation = 0) {
        return arm(Limb::kLeft, flexion, abduction, elbow, internal_rotation)
            .arm(Limb::kRight, flexion, abduction, elbow, internal_rotation);
    }
};

// Key poses of the arms on standing legs: raises, gestures, signals, throws; and rotations of trunk and head.
void add_arm_poses(std::vector<LibraryPose>& poses);  // key_poses_of_arms.cc

// Key poses of the legs: gaits, sprint start, squats, lunges, jumps, kicks, balance.
void add_leg_poses(std::vector<LibraryPose>& poses);  // key_poses_of_legs.cc

}  // namespace kinevox::database
