// The cost of an arm beside an unmoved body against that of the whole body.
#include "server/pose/arm_cost.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "server/pose/turned_posture.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

constexpr double kRobust_m = 0.04;

// The arm anywhere about the shoulder: inside the trunk, outside the silhouettes and below the floor, too.
BodyPosture with_arm_anywhere(BodyPosture posture, const LimbSegments& arm, std::mt19937& random) {
    std::uniform_real_distribution<> angle(-2, 2), bend(0, 2.5);
    posture.parent_from_segment[arm.upper] =
        rotation_from_rodrigues(Vec3{angle(random), angle(random), angle(random)});
    return forearm_moved(posture, arm.lower, angle(random), bend(random));
}

// Largest difference between the changes of both costs from one posture to another, over the mean change.
double relative_difference(const testing::SeenBody& scene, const BodyPosture& posture, Limb limb) {
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const LimbSegments arm = segments_of(limb);
    PoseCost whole;
    ArmCost moved(whole.options(), *scene.model, posture, arm, views, kRobust_m);
    const double before = whole.cost_of(*scene.model, posture, views, kRobust_m) - moved.cost_of(posture);
    std::mt19937 random(5);
    double largest = 0, sum = 0;
    constexpr int kCount = 200;
    for (int n = 0; n < kCount; ++n) {
        const BodyPosture other = with_arm_anywhere(posture, arm, random);
        const double cost = whole.cost_of(*scene.model, other, views, kRobust_m);
        largest = std::max(largest, std::abs(cost - moved.cost_of(other) - before));
        sum += std::abs(cost - before);
    }
    return largest / (sum / kCount);
}

TEST(ArmCost, ChangesAsTheCostOfTheWholeBody) {
    const testing::SeenBody scene;
    const BodyPosture standing = posture_from_coordinates(scene.standing());
    EXPECT_LT(relative_difference(scene, standing, Limb::kArmL), 1e-9);
    EXPECT_LT(relative_difference(scene, standing, Limb::kArmR), 1e-9);
}

TEST(ArmCost, ChangesAsTheCostOfTheWholeBodyOnTheFloor) {
    const testing::SeenBody scene;
    BodyPosture lying = posture_from_coordinates(scene.standing());
    lying.root_in_world.z = 0.1;
    EXPECT_LT(relative_difference(scene, lying, Limb::kArmR), 1e-9);
}

}  // namespace
}  // namespace kinevox
