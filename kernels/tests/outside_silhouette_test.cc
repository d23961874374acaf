// Balls that stick out of a half plane, whose distances are known.
#include "kernels/outside_silhouette.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace kinevox::kernels {
namespace {

constexpr double kMinDepth_m = 0.2, kFocal_px = 200;

PinholeView camera_at_origin() {
    PinholeView camera;
    camera.rotation[0] = camera.rotation[4] = camera.rotation[8] = 1;
    camera.fx = camera.fy = kFocal_px, camera.cx = 100, camera.cy = 80;
    camera.width = 200, camera.height = 160;
    return camera;
}

// Cells of 2 x 2 px from (20, 10) on; inside is what lies more than `border` px to the right.
struct Map {
    std::vector<float> distance;
    DistanceMapView view;
    explicit Map(float border) : distance(60 * 50) {
        for (int r = 0; r < 50; ++r)
            for (int c = 0; c < 60; ++c) distance[r * 60 + c] = 20 + 2 * c + 0.5f - border;
        view = {distance.data(), 60, 50, 2, 20, 10};
    }
};

struct Measured {
    std::array<std::vector<double>, 8> values;
    Measured(const PinholeView& camera, const DistanceMapView& map,
             const std::array<std::vector<double>, 4>& balls) {
        const std::size_t count = balls[0].size();
        for (auto& v : values) v.assign(count, 99);
        measure_outside(
            camera, map,
            {{balls[0].data(), balls[1].data(), balls[2].data()}, balls[3].data(), static_cast<int>(count)},
            kMinDepth_m,
            {values[0].data(),
             {values[1].data(), values[2].data(), values[3].data()},
             {values[4].data(), values[5].data()},
             {values[6].data(), values[7].data()}});
    }
};

TEST(MeasureOutside, IsRadiusLessDistanceToTheBorderAtTheBallsDepth) {
    std::mt19937 random(5);
    std::uniform_real_distribution<> px(22, 138), py(12, 106), depth(0.5, 6), size(0.02, 0.2);
    std::array<std::vector<double>, 4> balls;
    std::vector<double> column, row;
    for (int n = 0; n < 43; ++n) {  // no whole number of vectors
        const double x = px(random), y = py(random), z = depth(random);
        column.push_back(x), row.push_back(y);
        balls[0].push_back((x - 100) / kFocal_px * z), balls[1].push_back((y - 80) / kFocal_px * z);
        balls[2].push_back(z), balls[3].push_back(size(random));
    }
    const Map map(70);
    const Measured found(camera_at_origin(), map.view, balls);
    for (int n = 0; n < 43; ++n) {
        const double expected = balls[3][n] - (column[n] - 70) * balls[2][n] / kFocal_px;
        EXPECT_NEAR(found.values[0][n], expected, 1e-6) << n;
        EXPECT_NEAR(found.values[3][n], balls[2][n], 1e-12) << n;
        EXPECT_NEAR(found.values[4][n], 1, 1e-6) << n;
        EXPECT_NEAR(found.values[5][n], 0, 1e-6) << n;
        EXPECT_NEAR(found.values[6][n], column[n], 1e-9) << n;
        EXPECT_NEAR(found.values[7][n], row[n], 1e-9) << n;
    }
}

TEST(MeasureOutside, AddsTheDistanceToTheMap) {
    const Map map(70);
    // The first cell's centre is (20.5, 10.5); this ball is seen at (17.5, 6.5).
    const double z = 2;
    const Measured found(camera_at_origin(), map.view,
                         {{{(17.5 - 100) / kFocal_px * z}, {(6.5 - 80) / kFocal_px * z}, {z}, {0.1}}});
    EXPECT_NEAR(found.values[0][0], 0.1 + (70 - 20.5 + 5) * z / kFocal_px, 1e-6);
    EXPECT_NEAR(found.values[4][0], 1 + 3. / 5, 1e-6);
    EXPECT_NEAR(found.values[5][0], 4. / 5, 1e-6);
}

TEST(MeasureOutside, IsZeroWhereTheCameraSeesNothing) {
    const Map map(70);
    const std::array<std::vector<double>, 4> balls{
        {{0, 0, 3, 0}, {0, 0, 0, 0}, {-2, 0.1, 2, 0}, {1, 1, 1, 1}}};
    const Measured unseen(camera_at_origin(), map.view, balls);
    for (const double outside : unseen.values[0]) EXPECT_EQ(outside, 0);
    const Measured without_silhouette(camera_at_origin(), {}, {{{0}, {0}, {2}, {1}}});
    EXPECT_EQ(without_silhouette.values[0][0], 0);
}

TEST(MeasureOutside, IsConstantOverAMapOfOneCell) {
    const float distance = 7;
    const DistanceMapView one{&distance, 1, 1, 400, -100, -100};  // its centre is (99.5, 99.5)
    const Measured found(camera_at_origin(), one,
                         {{{(99.5 - 100) / kFocal_px}, {(99.5 - 80) / kFocal_px}, {1}, {0.5}}});
    EXPECT_NEAR(found.values[0][0], 0.5 - 7 / kFocal_px, 1e-9);
}

}  // namespace
}  // namespace kinevox::kernels
