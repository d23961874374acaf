// The density in 8-bit vectors against the formula in double precision, and against its own scalar form.
#include "kernels/cpu/segmentation_density.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/packed_samples.h"
#include "kernels/cpu/segmentation_model.h"

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

CellSamples samples_of(const Cell& cell, int sample_count) {
    return {cell.samples.data(), nullptr, sample_count};
}

class SegmentationDensity : public ::testing::TestWithParam<std::tuple<int, int>> {};

TEST_P(SegmentationDensity, EqualsFormulaInDoublePrecision) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    double squared_error = 0, bias = 0;
    int compared = 0;
    for (unsigned seed = 0; seed < 40; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        cell_density(tables, cell.value.data(), samples_of(cell, sample_count), cell.scale.data(), channels,
                     0, false, cell.density.data());
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

TEST_P(SegmentationDensity, VectorFormEqualsScalarForm) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    for (unsigned seed = 100; seed < 120; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        cell_density(tables, cell.value.data(), samples_of(cell, sample_count), cell.scale.data(), channels,
                     0, false, cell.density.data());
        for (int x = 0; x < kCellPixels; ++x)
            ASSERT_EQ(cell.density[x], kde::density(tables, cell.value.data() + x, cell.samples.data() + x,
                                                    cell.scale.data() + x, sample_count, channels))
                << "pixel " << x << " seed " << seed;
    }
}

TEST_P(SegmentationDensity, EndsEarlyOnlyForBackground) {
    const auto [sample_count, channels] = GetParam();
    const kde::DensityTables tables = make_density_tables(sample_count);
    for (unsigned seed = 200; seed < 230; ++seed) {
        Cell cell = random_cell(sample_count, channels, seed);
        AlignedVector<std::uint8_t> early(kCellPixels);
        const DensityLooks looks = cell_density(tables, cell.value.data(), samples_of(cell, sample_count),
                                                cell.scale.data(), channels, 0, true, early.data());
        cell_density(tables, cell.value.data(), samples_of(cell, sample_count), cell.scale.data(), channels,
                     0, false, cell.density.data());
        int unsure = 0;
        for (int x = 0; x < kCellPixels; ++x) {
            EXPECT_LE(early[x], cell.density[x]);
            if (!looks.plain) {
                EXPECT_EQ(early[x], cell.density[x]);
            }
            unsure += cell.density[x] < kde::kSureDensity;
        }
        EXPECT_EQ(looks.plain, unsure < kde::kCandidatesPerCell);
        cell_density(tables, cell.value.data(), samples_of(cell, sample_count), cell.scale.data(), channels,
                     looks.samples, false, early.data());
        EXPECT_EQ(early, cell.density) << "after " << looks.samples << " samples";
    }
}

// A row of three cells, the last of them with a pixel whose samples spread over 17 levels.
BackgroundModel narrow_model(int sample_count, int channels) {
    BackgroundModel model;
    model.width = 3 * kCellPixels, model.height = 1, model.channels = channels;
    model.sample_count = sample_count, model.cells_per_row = 3;
    std::mt19937 random(7);
    const std::size_t bytes = model.cell_bytes();
    model.samples.resize(3 * sample_count * bytes);
    for (int k = 0; k < 3; ++k)
        for (std::size_t x = 0; x < bytes; ++x) {
            const int lowest = static_cast<int>(random() % 241);
            for (int i = 0; i < sample_count; ++i)
                model.cell_samples(0, k)[i * bytes + x] = static_cast<std::uint8_t>(lowest + random() % 16);
        }
    if (sample_count > 1) {
        model.cell_samples(0, 2)[5] = 100;
        model.cell_samples(0, 2)[bytes + 5] = 116;
    }
    return model;
}

void expect_same_sums(const BackgroundModel& model, const PackedSamples& packed, int k) {
    const kde::DensityTables tables = make_density_tables(model.sample_count);
    const AlignedVector<std::uint8_t> scale(model.cell_bytes(), 40);
    AlignedVector<std::uint8_t> value(model.cell_bytes()), whole(kCellPixels), half(kCellPixels);
    BackgroundModel copy = model;
    const std::uint8_t* samples = copy.cell_samples(0, k);
    for (std::size_t x = 0; x < value.size(); ++x)
        value[x] = static_cast<std::uint8_t>(std::min(samples[x] + static_cast<int>(x % 12), 255));
    for (const bool may_stop : {false, true}) {
        const DensityLooks a = cell_density(tables, value.data(), {samples, nullptr, model.sample_count},
                                            scale.data(), model.channels, 0, may_stop, whole.data());
        const DensityLooks b = cell_density(
            tables, value.data(), {samples, packed.cell(model.cell_index(0, k)), model.sample_count},
            scale.data(), model.channels, 0, may_stop, half.data());
        EXPECT_EQ(a.samples, b.samples);
        EXPECT_EQ(a.plain, b.plain);
        EXPECT_EQ(whole, half) << "cell " << k;
    }
}

TEST_P(SegmentationDensity, PackedSamplesGiveSameSums) {
    const auto [sample_count, channels] = GetParam();
    BackgroundModel model = narrow_model(sample_count, channels);
    PackedSamples packed;
    packed.build(model);
    for (int k = 0; k < 3; ++k) {
        EXPECT_EQ(packed.cell(k) == nullptr, k == 2 && sample_count > 1) << "cell " << k;
        expect_same_sums(model, packed, k);
    }
    // New samples, inside the packed range and outside it, and one that makes the wide cell narrow again.
    std::mt19937 random(8);
    const std::size_t bytes = model.cell_bytes();
    for (int round = 0; round < 20; ++round)
        for (int k = 0; k < 3; ++k) {
            const int slot = static_cast<int>(random() % sample_count);
            std::uint8_t* sample = model.cell_samples(0, k) + slot * bytes;
            const int step = round % 4 == 3 ? 9 : 1;
            for (std::size_t x = 0; x < bytes; ++x)
                sample[x] = static_cast<std::uint8_t>(std::clamp(sample[x] + (x % 3 ? step : -step), 0, 255));
            packed.replace(model, k, slot);
            expect_same_sums(model, packed, k);
        }
    std::fill_n(model.cell_samples(0, 2), bytes * sample_count, std::uint8_t{90});
    packed.pack(model, 2);
    ASSERT_NE(packed.cell(2), nullptr);
    model.cell_samples(0, 2)[0] = 140;
    packed.replace(model, 2, 0);
    EXPECT_EQ(packed.cell(2) == nullptr, sample_count > 1);
    model.cell_samples(0, 2)[0] = 91;
    packed.replace(model, 2, 0);
    EXPECT_NE(packed.cell(2), nullptr);
    expect_same_sums(model, packed, 2);
}

INSTANTIATE_TEST_SUITE_P(AnyNumberOfSamples, SegmentationDensity,
                         ::testing::Combine(::testing::Values(1, 2, 5, 8, 32, 33, 64, 255),
                                            ::testing::Values(1, 3)));

TEST(SegmentationSplit, VectorFormEqualsScalarForm) {
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
