#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "server/recording/trial_formats.h"

namespace kinevox {
namespace {

constexpr EulerOrder kOrders[] = {{kAxisX, kAxisY, kAxisZ}, {kAxisX, kAxisZ, kAxisY},
                                  {kAxisY, kAxisX, kAxisZ}, {kAxisY, kAxisZ, kAxisX},
                                  {kAxisZ, kAxisX, kAxisY}, {kAxisZ, kAxisY, kAxisX}};
constexpr double kQuarter = std::numbers::pi / 2;

void expect_same(const Mat3& a, const Mat3& b) {
    for (int k = 0; k < 9; ++k) EXPECT_NEAR(a.m[k], b.m[k], 1e-9);
}

TEST(EulerAngles, RoundTripInEveryOrder) {
    for (const EulerOrder& order : kOrders)
        for (const EulerAngles& angles : {EulerAngles{0.3, -0.8, 2.9}, {-3.0, 1.5, 0.1}, {0, 0, 0}}) {
            const EulerAngles back = euler_from_rotation(rotation_from_euler(angles, order), order);
            for (int k = 0; k < 3; ++k) EXPECT_NEAR(back[k], angles[k], 1e-9);
        }
}

TEST(EulerAngles, KeepTheRotationAtTheSingularPose) {
    for (const EulerOrder& order : kOrders)
        for (const double middle : {kQuarter, -kQuarter}) {
            const Mat3 rotation = rotation_from_euler({0.7, middle, -0.4}, order);
            const EulerAngles back = euler_from_rotation(rotation, order);
            EXPECT_EQ(back[2], 0);
            for (int k = 0; k < 9; ++k)
                EXPECT_NEAR(rotation_from_euler(back, order).m[k], rotation.m[k], 1e-6);
        }
}

TEST(EulerAngles, FollowACurveContinuously) {
    const EulerOrder order{kAxisX, kAxisZ, kAxisY};
    EulerAngles last{};
    for (int n = 1; n < 200; ++n) {
        const EulerAngles true_angles{0.05 * n, 0.02 * n,
                                      -0.03 * n};  // past a turn and past the singular pose
        const Mat3 rotation = rotation_from_euler(true_angles, order);
        const EulerAngles next = nearest_euler(euler_from_rotation(rotation, order), last);
        expect_same(rotation_from_euler(next, order), rotation);
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(next[k], true_angles[k], 1e-6) << n;
        last = next;
    }
}

}  // namespace
}  // namespace kinevox
