#include "server/pose/body_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "common/body_pose.h"
#include "common/geometry.h"

namespace kinevox {
namespace {

// Height from the soles to the top of the head of a person who stands straight.
double standing_height(const BodyShape& s) {
    return s[kAnkleHeight] + s[kShank] + s[kThigh] + s[kRootToSacroiliac] + s[kSacroiliacToSkullbase] +
           s[kSkullbaseToHeadTop];
}

int dof(std::string_view name) {
    for (int k = 0; k < kBodyDofCount; ++k)
        if (kBodyDofs[k].name == name) return k;
    ADD_FAILURE() << name;
    return 0;
}
Vec3 joint(const PosedBody& posed, std::string_view name) {
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        if (kJointNames[j] == name) return posed.joints_in_world[j];
    ADD_FAILURE() << name;
    return {};
}

BodyCoordinates random_coordinates(unsigned seed) {
    std::mt19937 random(seed);
    BodyCoordinates q;
    for (int k = 0; k < kBodyDofCount; ++k) {
        const bool free = !std::isfinite(kBodyDofs[k].lower);
        const double lower = free ? -1.2 : kBodyDofs[k].lower, upper = free ? 1.2 : kBodyDofs[k].upper;
        q[k] = std::uniform_real_distribution<>(0.8 * lower, 0.8 * upper)(random);
    }
    return q;
}

TEST(BodyModel, ZeroPoseStandsUpright) {
    const BodyModel model(default_body_shape(1.80));
    const PosedBody posed = model.forward(BodyCoordinates{});
    const double height =
        joint(posed, "head_top").z - joint(posed, "ankle_l").z + model.shape()[kAnkleHeight];
    EXPECT_NEAR(height, 1.80, 0.03);
    EXPECT_NEAR(standing_height(model.shape()), 1.80, 0.03);
    EXPECT_GT(joint(posed, "hip_l").y, joint(posed, "hip_r").y);
    EXPECT_GT(joint(posed, "toe_l").x, joint(posed, "ankle_l").x + 0.1);
    EXPECT_LT(joint(posed, "hand_l").z, joint(posed, "shoulder_l").z - 0.6);
}

TEST(BodyModel, CoordinatesMoveAsNamed) {
    const BodyModel model(default_body_shape());
    const auto moved = [&](std::string_view name, double angle, std::string_view which) {
        BodyCoordinates q{};
        q[dof(name)] = radians(angle);
        return joint(model.forward(q), which) - joint(model.forward(BodyCoordinates{}), which);
    };
    for (const std::string side : {"l", "r"}) {
        const double outwards = side == "l" ? 1 : -1;
        EXPECT_GT(moved("hip_flexion_" + side, 30, "knee_" + side).x, 0.1);
        EXPECT_LT(outwards * moved("hip_adduction_" + side, 30, "knee_" + side).y, -0.1);
        EXPECT_LT(outwards * moved("hip_rotation_" + side, 30, "toe_" + side).y, -0.05);
        EXPECT_LT(moved("knee_angle_" + side, 30, "ankle_" + side).x, -0.1);
        EXPECT_GT(moved("ankle_angle_" + side, 20, "toe_" + side).z, 0.03);
        EXPECT_GT(moved("arm_flex_" + side, 30, "elbow_" + side).x, 0.1);
        EXPECT_GT(outwards * moved("arm_add_" + side, -30, "elbow_" + side).y, 0.1);
        EXPECT_GT(moved("elbow_flex_" + side, 30, "wrist_" + side).x, 0.1);
        EXPECT_LT(outwards * moved("wrist_flex_" + side, 30, "hand_" + side).y, -0.05);
    }
    EXPECT_LT(moved("lumbar_extension", 20, "skullbase").x, -0.1);
    EXPECT_LT(moved("lumbar_bending", 20, "skullbase").y, -0.1);
    EXPECT_GT(moved("lumbar_rotation", 20, "shoulder_r").x, 0.05);
    EXPECT_LT(moved("pelvic_tilt", 20, "skullbase").x, -0.1);
    EXPECT_GT(moved("pelvic_rotation", 20, "toe_l").y, 0.02);
}

TEST(BodyModel, GeometricAnglesFollowCoordinates) {
    const BodyModel model(default_body_shape());
    BodyCoordinates q{};
    q[dof("knee_angle_l")] = radians(70);
    q[dof("elbow_flex_r")] = radians(40);
    q[dof("hip_flexion_r")] = radians(50);
    q[dof("hip_adduction_l")] = radians(-20);
    q[dof("arm_add_l")] = radians(-90);
    q[dof("pelvic_rotation")] = radians(130);
    const auto angles = joint_angles(model.forward(q).joints_in_world);
    const auto at = [&](std::string_view name) { return angles[*angle_index(name)] / kDegree; };
    EXPECT_NEAR(at("knee_flexion_geometric_l"), 70, 1e-9);
    EXPECT_NEAR(at("elbow_flexion_geometric_r"), 40, 1e-9);
    EXPECT_NEAR(at("hip_flexion_geometric_r"), 50, 0.5);
    EXPECT_NEAR(at("hip_abduction_geometric_l"), 20, 0.5);
    EXPECT_NEAR(at("shoulder_elevation_geometric_l"), 90, 6);
}

TEST(BodyModel, CoordinatesRoundTripThroughRotations) {
    for (unsigned seed = 0; seed < 50; ++seed) {
        BodyCoordinates q = random_coordinates(seed);
        for (const int shoulder : {kDofShoulderL, kDofShoulderR})
            q[shoulder + 1] *= 0.45;  // below 90 deg: unique
        const BodyCoordinates back = coordinates_from_posture(posture_from_coordinates(q));
        for (int k = 0; k < kBodyDofCount; ++k) EXPECT_NEAR(back[k], q[k], 1e-9) << kBodyDofs[k].name;
    }
}

TEST(BodyModel, SingularPosesKeepRotation) {
    for (const double adduction : {-90.0, 90.0}) {
        BodyCoordinates q{};
        q[kDofShoulderL] = radians(20), q[kDofShoulderL + 1] = radians(adduction),
        q[kDofShoulderL + 2] = radians(30);
        q[kDofRootRotation] = radians(20), q[kDofRootRotation + 1] = radians(adduction),
        q[kDofRootRotation + 2] = radians(30);
        const BodyPosture posture = posture_from_coordinates(q);
        const BodyPosture back = posture_from_coordinates(coordinates_from_posture(posture));
        const BodyStep step = step_between(posture, back);
        for (const double d : step) EXPECT_NEAR(d, 0, 1e-4);
    }
}

TEST(BodyModel, StepBetweenConnectsPostures) {
    const BodyPosture a = posture_from_coordinates(random_coordinates(1)),
                      b = posture_from_coordinates(random_coordinates(2));
    const BodyStep left = step_between(stepped(a, step_between(a, b)), b);
    for (const double d : left) EXPECT_NEAR(d, 0, 1e-7);
}

TEST(BodyModel, JacobianMatchesNumericDifferences) {
    const BodyModel model(default_body_shape());
    constexpr double kStep = 1e-6;
    for (unsigned seed = 0; seed < 5; ++seed) {
        const BodyPosture posture = posture_from_coordinates(random_coordinates(seed));
        const PosedBody posed = model.forward(posture);
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            const auto jacobian = BodyModel::point_jacobian(model.dof_frames(posed), kJointSegment[j],
                                                            posed.joints_in_world[j]);
            for (int k = 0; k < kBodyDofCount; ++k) {
                BodyStep forth{}, back{};
                forth[k] = kStep, back[k] = -kStep;
                const Vec3 numeric = (model.forward(stepped(posture, forth)).joints_in_world[j] -
                                      model.forward(stepped(posture, back)).joints_in_world[j]) /
                                     (2 * kStep);
                EXPECT_NEAR(norm(numeric - jacobian[k]), 0, 1e-6)
                    << kJointNames[j] << ' ' << kBodyDofs[k].name;
            }
        }
    }
}

TEST(BodyModel, EulerRatesMatchNumericDifferences) {
    constexpr double kStep = 1e-6;
    BodyCoordinates q = random_coordinates(7);
    for (const int shoulder : {kDofShoulderL, kDofShoulderR}) q[shoulder + 1] *= 0.4;
    const BodyPosture posture = posture_from_coordinates(q);
    for (int s = 0; s < kBodySegmentCount; ++s) {
        if (kSegmentDofCount[s] != 3) continue;
        const Mat3 rates = euler_rates(s, posture.parent_from_segment[s]);
        for (int k = 0; k < 3; ++k) {
            BodyStep forth{}, back{};
            forth[kSegmentDof[s] + k] = kStep, back[kSegmentDof[s] + k] = -kStep;
            const BodyCoordinates there = coordinates_from_posture(stepped(posture, forth)),
                                  here = coordinates_from_posture(stepped(posture, back));
            for (int angle = 0; angle < 3; ++angle)
                EXPECT_NEAR(rates(angle, k),
                            (there[kSegmentDof[s] + angle] - here[kSegmentDof[s] + angle]) / (2 * kStep),
                            1e-6)
                    << kBodySegmentNames[s];
        }
    }
}

TEST(BodyModel, SurfaceStaysWithSegments) {
    const BodyModel model(default_body_shape());
    std::vector<BodyCapsule> standing;
    model.capsules(model.forward(BodyCoordinates{}), standing);
    ASSERT_EQ(standing.size(), model.capsules_in_segments().size());
    for (const BodyCapsule& c : standing) {
        EXPECT_GT(c.radius_a, 0.005f);
        EXPECT_GT(c.radius_b, 0.005f);
        EXPECT_LT(c.radius_a, 0.2f);
    }
}

}  // namespace
}  // namespace kinevox
