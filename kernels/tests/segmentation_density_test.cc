// The density in 8-bit vectors against the formula in double precision, and against its own scalar form.
#include "kernels/cpu/segmentation_density.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "kernels/cpu/aligned_vector.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;

struct Cell {
    AlignedVector<std::uint8_t> value, samples, scale, density;
};

// Values around samples around a level, so that densities of all sizes occur.
Cell random_cell(int sample_count, int channels, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_int_distribution<int> level(0, 255), bandwidth_scale(8, 255);
    std::uniform_real_distribution<double> spread(0.2, 4.0);
    const std::size_t plane = static_cast<std::size_t>(channels) * kCellPixels;
    Cell cell{AlignedVector<std::uint8_t>(plane), AlignedVector<std::uint8_t>(plane * sample_count),
              AlignedVector<std::uint8_t>(plane), AlignedVector<std::uint8_t>(kCellPixels)};
    for (std::size_t i = 0; i < plane; ++i) {
        const int middle = level(random);
        cell.scale[i] = static_cast<std::uint8_t>(bandwidth_scale(random));
        std::normal_distribution<double> near(middle, 256.0 / cell.scale[i] * spread(random) * 0.5);
        const auto draw = [&] {
            return static_cast<std::uint8_t>(std::clamp(std::lround(near(random)), 0l, 255l));
        };
        cell.value[i] = draw();
        for (int s = 0; s < sample_count; ++s) cell.samples[s * plane + i] = draw();
    }
    return cell;
}

// pdf(I) = 1/N sum_i prod_c K((I_c - I_ic) / h_c), over its highest value.
double reference_density(const Cell& cell, int pixel, int sample_count, int channels) {
    double sum = 0;
    for (int s = 0; s < sample_count; ++s) {
        double exponent = 0;
        for (int c = 0; c < channels; ++c) {
            const double h = 256.0 / cell.scale[c * kCellPixels + pixel];
            const double d = (static_cast<double>(cell.value[c * kCellPixels + pixel]) -
                              cell.samples[(s * channels + c) * kCellPixels + pixel]) /
                             h;
            exponent += d * d;
        }
        sum += std::exp(-0.5 * exponent);
    }
    return sum / sample_count;
}

class SegmentationDensity : public ::testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(SegmentationDensity, EqualsTheFormulaInDoublePrecision) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    double squared_error = 0, bias = 0;
    int compared = 0;
    for (unsigned seed = 0; seed < 40; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        cell_density(tables, cell.value.data(), cell.samples.data(), cell.scale.data(), sample_count,
                     channels, 0, false, cell.density.data());
        for (int x = 0; x < kCellPixels; ++x) {
            const double expected = reference_density(cell, x, sample_count, channels);
            const double top = kde::saturation(sample_count);
            const double got = cell.density[x] / 255.0 * top;
            const double error = got - std::min(expected, top);
            EXPECT_LT(std::abs(error), 0.35 * top + 0.02) << "pixel " << x << " seed " << seed;
            squared_error += error * error / (top * top);
            bias += error / top;
            ++compared;
        }
    }
    EXPECT_LT(std::sqrt(squared_error / compared), 0.08);
    EXPECT_LT(std::abs(bias / compared), 0.04);
}

TEST_P(SegmentationDensity, VectorsGiveTheScalarFormsBits) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    for (unsigned seed = 100; seed < 120; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        cell_density(tables, cell.value.data(), cell.samples.data(), cell.scale.data(), sample_count,
                     channels, 0, false, cell.density.data());
        for (int x = 0; x < kCellPixels; ++x)
            ASSERT_EQ(cell.density[x], kde::density(tables, cell.value.data() + x, cell.samples.data() + x,
                                                    cell.scale.data() + x, sample_count, channels))
                << "pixel " << x << " seed " << seed;
    }
}

TEST_P(SegmentationDensity, EndsEarlyOnlyWhereThePixelsAreBackgroundAnyway) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    for (unsigned seed = 200; seed < 230; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        AlignedVector<std::uint8_t> early(kCellPixels);
        const DensityLooks looks =
            cell_density(tables, cell.value.data(), cell.samples.data(), cell.scale.data(), sample_count,
                         channels, 0, true, early.data());
        cell_density(tables, cell.value.data(), cell.samples.data(), cell.scale.data(), sample_count,
                     channels, 0, false, cell.density.data());
        int unsure = 0;
        for (int x = 0; x < kCellPixels; ++x) {
            EXPECT_LE(early[x], cell.density[x]);
            if (!looks.plain) {
                EXPECT_EQ(early[x], cell.density[x]);
            }
            unsure += cell.density[x] < kde::kSureDensity;
        }
        EXPECT_EQ(looks.plain, unsure < kde::kCandidatesPerCell);
        cell_density(tables, cell.value.data(), cell.samples.data(), cell.scale.data(), sample_count,
                     channels, looks.samples, false, early.data());
        EXPECT_EQ(early, cell.density) << "after " << looks.samples << " samples";
    }
}

INSTANTIATE_TEST_SUITE_P(AnyNumberOfSamples, SegmentationDensity,
                         ::testing::Combine(::testing::Values(1, 2, 5, 8, 32, 33, 64, 255),
                                            ::testing::Values(1, 3)));

TEST(SegmentationSplit, VectorsGiveTheScalarFormsBits) {
    std::mt19937 random(3);
    for (int channels : {1, 3}) {
        AlignedVector<std::uint8_t> pixels(kCellPixels * channels), whole(pixels.size()), part(pixels.size());
        for (auto& value : pixels) value = static_cast<std::uint8_t>(random() % 256);
        const std::uint16_t gain[3] = {16384, 15000, 19000};
        split_cell(pixels.data(), kCellPixels, channels, gain, whole.data());
        split_cell(pixels.data(), kCellPixels - 1, channels, gain, part.data());  // the plain form
        for (int c = 0; c < channels; ++c)
            for (int x = 0; x < kCellPixels - 1; ++x) {
                ASSERT_EQ(whole[c * kCellPixels + x], part[c * kCellPixels + x]);
                const int value = pixels[x * channels + c];
                const double expected = value >= 253 ? 255 : std::min(255.0, value * gain[c] / 16384.0);
                ASSERT_NEAR(whole[c * kCellPixels + x], expected, 0.52);
            }
    }
}

}  // namespace
}  // namespace kinevox::kernels::cpu
