// The path through candidate postures, and what it says about ambiguity.
#include "server/pose/pose_path.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "common/body_pose.h"
#include "common/geometry.h"

namespace kinevox {
namespace {

constexpr double kInterval_s = 1 / 15.0;

// A body that moves along x, its left wrist displaced.
PathCandidate candidate(int n, double wrist_m, double cost) {
    PathCandidate c;
    c.cost = cost;
    for (std::size_t j = 0; j < c.joints_in_world.size(); ++j)
        c.joints_in_world[j] = {0.1 * n, 0.05 * static_cast<double>(j), 1};
    for (const char* joint : {"elbow_l", "wrist_l", "hand_l"})
        c.joints_in_world[*joint_index(joint)].z += wrist_m;
    return c;
}

std::vector<PathFrame> frames(int count) {
    std::vector<PathFrame> made(count);
    for (int n = 0; n < count; ++n) made[n] = {n * kInterval_s, {candidate(n, 0, 10)}};
    return made;
}

TEST(PosePath, IgnoresCheaperLimbOfSingleFrameSet) {
    std::vector<PathFrame> seen = frames(12);
    seen[6].candidates.push_back(candidate(6, 0.5, 6));
    const auto path = choose_path(seen);
    EXPECT_EQ(path[6].candidate, 0) << "an arm does not jump by half a metre and back";
    EXPECT_GT(path[6].probability[0], 0.9);
}

TEST(PosePath, FollowsLimbThatStaysElsewhere) {
    std::vector<PathFrame> seen = frames(30);
    for (int n = 8; n < 30; ++n) seen[n].candidates.push_back(candidate(n, 0.5, 2));
    const auto path = choose_path(seen);
    EXPECT_EQ(path[20].candidate, 1);
    EXPECT_EQ(path[3].candidate, 0);
}

TEST(PosePath, SharesProbabilityBetweenEqualCandidates) {
    std::vector<PathFrame> seen = frames(20);
    for (int n = 0; n < 20; ++n) seen[n].candidates.push_back(candidate(n, 0.3, 10));
    const auto path = choose_path(seen);
    for (const PathChoice& choice : path) {
        EXPECT_NEAR(choice.probability[0], 0.5, 1e-6);
        EXPECT_NEAR(std::accumulate(choice.probability.begin(), choice.probability.end(), 0.0), 1, 1e-9);
    }
}

TEST(PosePath, DoubtsLegsThatFitExchanged) {
    std::vector<PathFrame> seen = frames(20);
    const auto ankles = [](PathCandidate& c, double left_m) {
        c.joints_in_world[*joint_index("ankle_l")].y = left_m;
        c.joints_in_world[*joint_index("ankle_r")].y = -left_m;
    };
    for (int n = 0; n < 20; ++n) {
        seen[n].candidates.push_back(candidate(n, 0.3, 12));
        for (PathCandidate& c : seen[n].candidates) ankles(c, 0.3);
    }
    seen[9].candidates.push_back(candidate(9, 0, 25));
    ankles(seen[9].candidates.back(), -0.3);
    const auto path = choose_path(seen);
    EXPECT_LT(path[9].probability[2], 0.01) << "legs do not jump";
    const std::vector<double> probability = exchanged_legs_probability(seen, path);
    for (int n = 0; n < 20; ++n)
        if (n >= 8 && n <= 10)
            EXPECT_NEAR(probability[n], 1 / (1 + std::exp(0.75)), 0.02) << n;
        else
            EXPECT_EQ(probability[n], 0) << n;
}

TEST(PosePath, PrefersColoursWhereSilhouettesAllowBoth) {
    std::vector<PathFrame> seen = frames(20);
    for (int n = 0; n < 20; ++n) {
        seen[n].candidates.push_back(candidate(n, 0.3, 12));
        seen[n].candidates[0].colour_cost = -5, seen[n].candidates[1].colour_cost = -40;
    }
    for (const PathChoice& choice : choose_path(seen)) {
        EXPECT_EQ(choice.candidate, 1);
        EXPECT_GT(choice.probability[1], 0.9);
    }
}

// Ten frame sets per second, three of them cheaper from behind.
TEST(PosePath, DoesNotTurnAroundAndBack) {
    std::vector<PathFrame> seen(12);
    for (int n = 0; n < 12; ++n) {
        const auto at = [&](double side_m, double cost) {
            PathCandidate c;
            c.cost = cost;
            c.joints_in_world.fill({0.1 * n, 0, 1});
            c.joints_in_world[*joint_index("shoulder_l")].y = side_m;
            c.joints_in_world[*joint_index("shoulder_r")].y = -side_m;
            return c;
        };
        seen[n] = {0.1 * n, {at(0.18, 20)}};
        if (n >= 4 && n < 7) seen[n].candidates.push_back(at(-0.18, 5));
    }
    const auto path = choose_path(seen);
    for (int n = 0; n < 12; ++n) EXPECT_EQ(path[n].candidate, 0) << n;
}

TEST(PosePath, ContinuesAfterFrameSetsWithoutPose) {
    std::vector<PathFrame> seen = frames(9);
    seen[0].candidates.clear(), seen[4].candidates.clear(), seen[6].candidates.clear();
    const auto path = choose_path(seen);
    for (const int n : {0, 4, 6}) EXPECT_EQ(path[n].candidate, -1) << n;
    for (const int n : {1, 3, 5, 7, 8}) EXPECT_EQ(path[n].candidate, 0) << n;
}

// Twice as many frame sets of the same motion are not twice the evidence.
TEST(PosePath, DoesNotDependOnRate) {
    for (const double fps : {15.0, 30.0, 60.0, 120.0}) {
        const int count = static_cast<int>(fps);
        std::vector<PathFrame> seen(count);
        for (int n = 0; n < count; ++n) {
            const double s = n / fps;
            const auto at = [&](double wrist_m, double cost) {
                PathCandidate c = candidate(0, wrist_m, cost);
                for (Vec3& joint : c.joints_in_world) joint.x = 1.5 * s;
                return c;
            };
            seen[n] = {s, {at(0, 10)}};
            if (s > 0.4 && s < 0.6) seen[n].candidates.push_back(at(0.5, 6));
        }
        EXPECT_EQ(choose_path(seen)[count / 2].candidate, 0) << fps << " frame sets per second";
    }
}

}  // namespace
}  // namespace kinevox
