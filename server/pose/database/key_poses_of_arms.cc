#include <fmt/format.h>

#include <array>

#include "server/pose/database/pose_builder.h"

namespace kinevox::database {
namespace {

struct ArmPose {
    const char* name;
    double flexion, abduction, elbow, rotation;
};
constexpr std::array<ArmPose, 16> kArms{{
    {"down", 2, 8, 12, 0},
    {"forward low", 40, 8, 15, 0},
    {"forward", 85, 4, 10, 0},
    {"forward high", 130, 6, 10, 0},
    {"up", 170, 10, 8, 0},
    {"sideways low", 2, 40, 10, 0},
    {"sideways", 2, 88, 6, 0},
    {"sideways high", 4, 130, 10, 0},
    {"forearm forward", 8, 10, 90, 10},
    {"hand at chest", 28, 18, 125, 55},
    {"hand at head", 60, 70, 135, -20},
    {"hand on hip", -22, 42, 85, 50},
    {"elbow up, forearm up", 10, 88, 90, -85},
    {"reaching across", 75, -25, 25, 20},
    {"back", -45, 12, 10, 0},
    {"pointing, bent", 70, 35, 60, 10},
}};

PoseBuilder standing(int stance) {
    PoseBuilder pose;
    pose.trunk(2, 0, 0);
    if (stance == 0) return pose.legs(2, 5, 2, 3);
    if (stance == 1) return pose.legs(8, 16, 8, 12);                              // wide, soft knees
    return pose.leg(Limb::kLeft, 20, 10, 0, 3).leg(Limb::kRight, -10, 14, 8, 3);  // a step
}

}  // namespace

void add_arm_poses(std::vector<LibraryPose>& poses) {
    for (std::size_t left = 0; left < kArms.size(); ++left) {
        for (std::size_t right = 0; right < kArms.size(); ++right) {
            const ArmPose &l = kArms[left], &r = kArms[right];
            PoseBuilder pose = standing(left == right ? 0 : static_cast<int>((left + 2 * right) % 3));
            pose.arm(Limb::kLeft, l.flexion, l.abduction, l.elbow, l.rotation)
                .arm(Limb::kRight, r.flexion, r.abduction, r.elbow, r.rotation);
            poses.push_back({left == right ? fmt::format("both arms {}", l.name)
                                           : fmt::format("left arm {}, right arm {}", l.name, r.name),
                             pose.q});
        }
    }
    for (const double angle : {-30.0, 30.0}) {
        for (const ArmPose& arm : {kArms[0], kArms[6], kArms[9]}) {
            const auto add = [&](const char* what, PoseBuilder pose) {
                pose.arms(arm.flexion, arm.abduction, arm.elbow, arm.rotation);
                poses.push_back({fmt::format("{} {:.0f} deg, arms {}", what, angle, arm.name), pose.q});
            };
            add("trunk rotated", standing(1).bend(0, angle));
            add("trunk bent sideways", standing(1).bend(angle, 0));
        }
    }
    for (const double lean : {25.0, 50.0, 75.0}) {  // picking something up
        poses.push_back(
            {fmt::format("bent forward {:.0f} deg, arms hanging", lean),
             PoseBuilder().trunk(0.6 * lean, 0.5 * lean).legs(0.6 * lean, 10, 4, 4).arms(lean, 5, 8).q});
        poses.push_back({fmt::format("bent forward {:.0f} deg, hands on knees", lean),
                         PoseBuilder()
                             .trunk(0.6 * lean, 0.5 * lean)
                             .legs(0.6 * lean + 15, 25, 12, 8)
                             .arms(0.7 * lean, 15, 30)
                             .q});
    }
}

}  // namespace kinevox::database
