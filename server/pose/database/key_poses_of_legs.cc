#include <fmt/format.h>

#include <array>
#include <cmath>

#include "server/pose/database/pose_builder.h"

namespace kinevox::database {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

// Angles of one leg over a stride in degrees, from one heel contact to the next, at eight equal steps.
struct GaitCurves {
    const char* name;
    std::array<double, 8> hip, knee, ankle;
    double lean, lumbar, arm_swing, arm_mean, elbow, elbow_swing;
};
// Perry, Gait Analysis (1992); Novacheck, The biomechanics of running (1998); Mann & Hagy (1980) for
// sprinting.
constexpr GaitCurves kWalk{"walk",
                           {28, 22, 8, -6, -10, 8, 28, 32},
                           {4, 17, 8, 6, 30, 60, 45, 8},
                           {0, -3, 6, 9, -12, -6, 2, 0},
                           3,
                           1,
                           24,
                           2,
                           20,
                           10};
constexpr GaitCurves kRun{"run",
                          {38, 25, 2, -10, -4, 25, 48, 46},
                          {18, 40, 25, 25, 75, 105, 80, 30},
                          {5, 22, 5, -22, -15, 0, 5, 5},
                          8,
                          2,
                          38,
                          -4,
                          90,
                          16};
constexpr GaitCurves kSprint{"sprint",
                             {45, 20, -5, -16, 5, 45, 78, 65},
                             {28, 35, 18, 35, 105, 130, 95, 35},
                             {2, 15, -10, -32, -20, 0, 5, 5},
                             12,
                             4,
                             55,
                             2,
                             92,
                             22};

double at_phase(const std::array<double, 8>& curve, double phase) {
    const double place = (phase - std::floor(phase)) * 8;
    const int n = static_cast<int>(place);
    const double t = place - n, s = t * t * (3 - 2 * t);
    return (1 - s) * curve[n % 8] + s * curve[(n + 1) % 8];
}

PoseBuilder gait_pose(const GaitCurves& gait, double phase, double stride, double arms, double lean) {
    PoseBuilder pose;
    pose.trunk(0.6 * (gait.lean + lean), 0.4 * (gait.lean + lean) + gait.lumbar, 0.6 * (gait.lean + lean));
    // Leaning the trunk rotates the pelvis; hip angles are relative to it.
    const double with_pelvis = 0.6 * lean;
    for (const Limb side : {Limb::kLeft, Limb::kRight}) {
        const double own = phase + (side == Limb::kRight ? 0.5 : 0.0);
        pose.leg(side, stride * at_phase(gait.hip, own) + with_pelvis,
                 (0.5 + 0.5 * stride) * at_phase(gait.knee, own), at_phase(gait.ankle, own));
        const double swing = -std::cos(kTurn * own);
        pose.arm(side, gait.arm_mean + with_pelvis + arms * gait.arm_swing * swing, 8,
                 gait.elbow + arms * gait.elbow_swing * swing, 20);
    }
    pose.bend(0, -8 * stride * std::cos(kTurn * phase));
    pose.q[kDofRootRotation + 1] = radians(3 * std::cos(kTurn * phase - 2.5));
    return pose;
}

void add_gaits(std::vector<LibraryPose>& poses) {
    constexpr int kPhases = 16;
    for (const GaitCurves* gait : {&kWalk, &kRun, &kSprint}) {
        for (const double stride : {0.6, 0.85, 1.1}) {
            for (int n = 0; n < kPhases; ++n)
                poses.push_back(
                    {fmt::format("{} {}/{}, stride {:.0f} %", gait->name, n, kPhases, 100 * stride),
                     gait_pose(*gait, static_cast<double>(n) / kPhases, stride, stride, 0).q});
        }
    }
    // Drive phase: running, still leaning forward.
    for (const double lean : {20.0, 32.0, 44.0})
        for (int n = 0; n < 12; ++n)
            poses.push_back({fmt::format("sprint drive {}/12, lean {:.0f} deg", n, lean),
                             gait_pose(kSprint, n / 12.0, 0.9, 1, lean).q});
    // Walking with other arm poses.
    for (int n = 0; n < 8; ++n) {
        poses.push_back(
            {fmt::format("walk {}/8, arms out", n), gait_pose(kWalk, n / 8.0, 0.8, 0, 0).arms(0, 75, 15).q});
        poses.push_back({fmt::format("walk {}/8, forearms up", n),
                         gait_pose(kWalk, n / 8.0, 0.8, 0, 0).arms(25, 15, 95, 20).q});
        poses.push_back(
            {fmt::format("walk {}/8, small steps", n), gait_pose(kWalk, n / 8.0, 0.35, 0.5, 2).q});
    }
}

void add_both_sides(std::vector<LibraryPose>& poses, const std::string& label, const PoseBuilder& pose) {
    poses.push_back({label + ", left", pose.q});
    poses.push_back({label + ", right", mirrored(pose.q)});
}

void add_sprint_start(std::vector<LibraryPose>& poses) {
    for (const double hips : {0.0, 10.0, 20.0}) {  // higher hips: less flexion
        PoseBuilder set;
        set.trunk(72 + 0.5 * hips, 24, 5)
            .leg(Limb::kLeft, 102 - 0.6 * hips, 95 - hips, 12)
            .leg(Limb::kRight, 78 - hips, 60 - 0.8 * hips, 15);
        add_both_sides(poses, fmt::format("sprint set, hips up {:.0f}", hips), set.arms(92, 12, 4));
    }
    for (const double off : {0.3, 0.6, 1.0}) {  // from the hands' lift to the front leg's push-off
        PoseBuilder push;
        push.trunk(68 - 18 * off, 22 - 8 * off, 10)
            .leg(Limb::kLeft, 95 - 90 * off, 85 - 75 * off, 5 - 25 * off)
            .leg(Limb::kRight, 60 + 45 * off, 60 + 45 * off, 8)
            .arm(Limb::kLeft, 92 + 10 * off, 15, 30 + 55 * off, 10)
            .arm(Limb::kRight, 70 - 105 * off, 15, 30 + 50 * off, 10);
        add_both_sides(poses, fmt::format("sprint push-off {:.0f} %", 100 * off), push);
    }
    PoseBuilder marks;  // kneeling on the rear knee
    add_both_sides(
        poses, "sprint on your marks",
        marks.trunk(62, 30, 0).leg(Limb::kLeft, 115, 115, 15).leg(Limb::kRight, 65, 100, 15).arms(95, 14, 5));
}

void add_squats_and_lunges(std::vector<LibraryPose>& poses) {
    for (const double depth : {0.2, 0.45, 0.7, 1.0}) {
        for (const double wide : {4.0, 16.0, 30.0}) {
            PoseBuilder squat;
            squat.trunk(32 * depth, 12 * depth, 25 * depth).legs(105 * depth, 120 * depth, 28 * depth, wide);
            const std::string name = fmt::format("squat {:.0f} %, feet {:.0f} deg", 100 * depth, wide);
            poses.push_back({name + ", arms forward", PoseBuilder(squat).arms(85, 5, 10).q});
            poses.push_back({name + ", arms down", PoseBuilder(squat).arms(35 * depth, 12, 20).q});
            poses.push_back({name + ", hands at chest", PoseBuilder(squat).arms(35, 15, 125, 40).q});
        }
    }
    for (const double depth : {0.35, 0.7, 1.0}) {
        PoseBuilder lunge;
        lunge.trunk(4 + 8 * depth, 4, 5)
            .leg(Limb::kLeft, 85 * depth, 88 * depth, 8)
            .leg(Limb::kRight, -22 * depth, 70 * depth, 12);
        const std::string name = fmt::format("lunge {:.0f} %", 100 * depth);
        add_both_sides(poses, name + ", arms down", PoseBuilder(lunge).arms(5, 10, 15));
        add_both_sides(poses, name + ", guard", PoseBuilder(lunge).arms(40, 12, 110, 25));
        add_both_sides(
            poses, name + ", punch",
            PoseBuilder(lunge).arm(Limb::kRight, 85, 5, 8).arm(Limb::kLeft, -10, 10, 100, 20).bend(0, 25));
        PoseBuilder straight;  // rear leg straight, as in a fencer's or a karate stance
        straight.trunk(4, 2, 2)
            .leg(Limb::kLeft, 75 * depth, 85 * depth, 10)
            .leg(Limb::kRight, -20 - 8 * depth, 6, 15, 10);
        add_both_sides(poses, name + ", rear leg straight", straight.arms(30, 25, 70));
        PoseBuilder sideways;
        sideways.trunk(15 * depth, 8 * depth)
            .leg(Limb::kLeft, 75 * depth, 95 * depth, 20, 20)
            .leg(Limb::kRight, 20 * depth, 4, 0, 38 * depth);
        add_both_sides(poses, fmt::format("side lunge {:.0f} %", 100 * depth), sideways.arms(40, 15, 60, 20));
    }
}

void add_jumps(std::vector<LibraryPose>& poses) {
    for (const double arms : {-40.0, 60.0, 165.0}) {
        poses.push_back({fmt::format("jump, crouch, arms {:.0f}", arms),
                         PoseBuilder().trunk(35, 15, 15).legs(80, 85, 25, 6).arms(arms, 12, 12).q});
        poses.push_back({fmt::format("jump, flight, arms {:.0f}", arms),
                         PoseBuilder().trunk(2, -4, 5).legs(2, 10, -35, 5).arms(arms, 15, 12).q});
        poses.push_back({fmt::format("jump, tucked, arms {:.0f}", arms),
                         PoseBuilder().trunk(10, 12, 5).legs(95, 100, -10, 8).arms(arms, 15, 20).q});
    }
    for (const double open : {0.25, 0.5, 0.75, 1.0})
        poses.push_back(
            {fmt::format("jumping jack {:.0f} %", 100 * open),
             PoseBuilder().trunk(2, 0).legs(2, 10, -10, 26 * open).arms(4, 10 + 155 * open, 20).q});
}

void add_balance_and_kicks(std::vector<LibraryPose>& poses) {
    for (const double height : {0.4, 0.7, 1.0}) {
        const std::string percent = fmt::format("{:.0f} %", 100 * height);
        const PoseBuilder standing = PoseBuilder().trunk(0, 0).leg(Limb::kRight, 2, 6, 3);
        const auto with = [&](double hip, double knee, double abduction, double lean, double lumbar) {
            return PoseBuilder(standing)
                .trunk(lean, lumbar)
                .leg(Limb::kLeft, hip, knee, -5, abduction)
                .leg(Limb::kRight, 2 + lean, 6, 3);
        };
        for (const auto& [arms_name, flexion, abduction, elbow] :
             {std::tuple{"arms out", 5.0, 85.0, 8.0}, std::tuple{"arms down", 0.0, 14.0, 15.0}}) {
            // Named, since Clang 14 cannot capture structured bindings.
            const auto add = [&, arms_name = arms_name, flexion = flexion, abduction = abduction,
                              elbow = elbow](const char* what, PoseBuilder pose) {
                add_both_sides(poses, fmt::format("{} {}, {}", what, percent, arms_name),
                               pose.arms(flexion, abduction, elbow));
            };
            add("balance, knee up", with(95 * height, 100 * height, 2, 0, 0));
            add("balance, leg forward", with(85 * height, 8, 2, -6 * height, 0));
            add("balance, leg sideways", with(0, 6, 58 * height, 0, 0).bend(-12 * height, 0));
            add("balance, leg back", with(-25 * height, 12, 2, 75 * height * height, 0));
        }
        add_both_sides(poses, "kick forward " + percent,
                       with(120 * height, 15, 5, -12 * height, 5).arms(35, 15, 105, 30));
        add_both_sides(poses, "kick, chambered " + percent,
                       with(115 * height, 125, 10, -5, 8).arms(35, 15, 110, 30));
        add_both_sides(poses, "kick sideways " + percent,
                       with(40 * height, 10, 60 * height, 0, 5).bend(-22 * height, 0).arms(25, 30, 90, 20));
    }
}

}  // namespace

void add_leg_poses(std::vector<LibraryPose>& poses) {
    add_gaits(poses);
    add_sprint_start(poses);
    add_squats_and_lunges(poses);
    add_jumps(poses);
    add_balance_and_kicks(poses);
}

}  // namespace kinevox::database
