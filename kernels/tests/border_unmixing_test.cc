// The border's rows as the CPU decides them, by vectors or not, against the pixel's own definition.
#include "kernels/cpu/border_unmixing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace kinevox::kernels::cpu {
namespace {

struct Scene {
    static constexpr int kWidth = 200, kHeight = 30, kCells = (kWidth + 63) / 64;
    int channels;
    std::vector<std::uint8_t> zones, values, reference;

    Scene(int channel_count, unsigned seed) : channels(channel_count) {
        std::mt19937 random(seed);
        std::uniform_int_distribution<int> zone(0, 5), grey(0, 255), noise(-6, 6);
        zones.resize(kWidth * kHeight + 8);
        for (auto& z : zones) z = static_cast<std::uint8_t>(zone(random) % 3);
        const std::size_t bytes = static_cast<std::size_t>(kHeight) * kCells * channels * kde::kCellPixels;
        values.resize(bytes), reference.resize(bytes);
        for (std::size_t n = 0; n < bytes; ++n) {
            reference[n] = static_cast<std::uint8_t>(grey(random));
            // Half of it near the background, so that both answers come.
            values[n] = static_cast<std::uint8_t>(n % 2 ? grey(random)
                                                        : std::clamp(reference[n] + noise(random), 0, 255));
        }
    }
    BorderImages images(const Rect& limit) const {
        return {kWidth, limit, zones.data(), values.data(), reference.data(), kCells, channels, {}};
    }
};

class BorderUnmixing : public ::testing::TestWithParam<int> {};

TEST_P(BorderUnmixing, RowEqualsSinglePixels) {
    const Scene scene(GetParam(), 5);
    int subject = 0, background = 0, untold = 0;
    for (const Rect& limit : {Rect{0, 0, Scene::kWidth, Scene::kHeight}, Rect{17, 4, 150, 23}}) {
        const BorderImages p = scene.images(limit);
        for (int y = limit.y0; y < limit.y1; ++y) {
            std::vector<std::uint8_t> row(Scene::kWidth, 77);
            unmix_row(p, y, limit.x0, limit.x1, row.data());
            for (int x = 0; x < Scene::kWidth; ++x) {
                int part = -1;
                if (x >= limit.x0 && x < limit.x1 && scene.zones[y * Scene::kWidth + x] == kde::kZoneBorder)
                    part = scene.channels == 1
                               ? kde::unmix_border_pixel<1>(x, y, p.width, limit, p.zones, p.values,
                                                            p.reference, p.cells_per_row, p.parameters)
                               : kde::unmix_border_pixel<3>(x, y, p.width, limit, p.zones, p.values,
                                                            p.reference, p.cells_per_row, p.parameters);
                ASSERT_EQ(row[x], part < 0 ? 77 : part ? 255 : 0) << "x " << x << " y " << y;
                (part < 0 ? untold : part ? subject : background) += 1;
            }
        }
    }
    EXPECT_GT(subject, 200);
    EXPECT_GT(background, 200);
    EXPECT_GT(untold, 200);
}

INSTANTIATE_TEST_SUITE_P(Channels, BorderUnmixing, ::testing::Values(1, 3));

}  // namespace
}  // namespace kinevox::kernels::cpu
