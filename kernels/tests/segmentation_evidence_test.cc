// The evidence in vectors against its scalar form, and which pixels it is worked out for.
#include "kernels/cpu/segmentation_evidence.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {
namespace {

using kde::kCellPixels;
using kde::kGroupPixels;

constexpr float kUntouched = 1234.0f;

// A cell of random pixels and the planes of its light, with room around for the neighbourhoods.
struct Scene {
    explicit Scene(int channels) : channels(channels) {
        std::mt19937 random(11);
        const auto draw = [&](int low, int high) {
            return static_cast<std::uint8_t>(low + static_cast<int>(random() % (high - low + 1)));
        };
        const std::size_t plane = static_cast<std::size_t>(channels) * kCellPixels;
        for (auto* bytes : {&value, &reference, &scale}) bytes->resize(plane);
        for (std::size_t i = 0; i < plane; ++i) {
            reference[i] = draw(0, 255);
            value[i] = static_cast<std::uint8_t>(std::clamp(reference[i] * draw(2, 9) / 6, 0, 255));
            scale[i] = draw(8, 102);
        }
        density.resize(kCellPixels);
        log_peak.resize(kCellPixels);
        for (int x = 0; x < kCellPixels; ++x) {
            density[x] = x % 3 == 0 ? std::uint8_t{0} : draw(0, 255);
            log_peak[x] = -6.0f + 0.01f * static_cast<float>(draw(0, 200));
        }
        log_lit.resize(256);
        for (int i = 0; i < 256; ++i) log_lit[i] = std::log(static_cast<float>(std::max(i, 1)) / 2040.0f);
        log_foreground.resize(channels == 1 ? 16 : 4096);
        for (float& entry : log_foreground) entry = -16.0f + 0.05f * static_cast<float>(draw(0, 200));
        neighbourhood.resize(5 * kStride);
        for (float& light : neighbourhood) light = 0.3f + 0.005f * static_cast<float>(draw(0, 200));
    }
    EvidenceCell cell() const {
        return {value.data(), reference.data(), scale.data(), density.data(), log_peak.data(), channels};
    }

    static constexpr std::ptrdiff_t kStride = kCellPixels + 8;
    int channels;
    AlignedVector<std::uint8_t> value, reference, scale, density;
    AlignedVector<float> log_peak;
    std::vector<float> log_lit, log_foreground, neighbourhood;
};

template <int kChannels>
void expect_scalar_values(int groups) {
    const Scene s(kChannels);
    const kde::EvidenceParameters p;
    std::vector<float> planes[10];
    for (auto& plane : planes) plane.assign(kCellPixels, kUntouched);
    fit_light_cell(s.cell(), groups, p,
                   {planes[0].data(), planes[1].data(), planes[2].data(), planes[3].data(), planes[4].data(),
                    planes[5].data(), planes[6].data()});
    const float* around = s.neighbourhood.data() + 2 * Scene::kStride + 4;
    // Factors and residuals everywhere, so that untouched pixels show.
    std::vector<float> factor(kCellPixels), residual(kCellPixels);
    for (int x = 0; x < kCellPixels; ++x) {
        const kde::PixelLight light = kde::fit_light<kChannels>(&s.value[x], &s.reference[x], &s.scale[x], p);
        factor[x] = light.factor, residual[x] = light.residual;
        const float expected[7] = {light.weighted_value, light.weighted_energy, light.factor, light.residual,
                                   light.product,        light.energy,          light.square};
        const float tolerance[7] = {0.05f, 0.05f, 1e-5f, 1e-4f, 0.05f, 0.05f, 0.05f};
        if (groups >> x / kGroupPixels & 1) {
            for (int n = 0; n < 7; ++n)
                EXPECT_NEAR(planes[n][x], expected[n], 1e-4f * std::abs(expected[n]) + tolerance[n])
                    << x << " plane " << n;
        } else {
            for (int n = 0; n < 7; ++n) EXPECT_EQ(planes[n][x], kUntouched) << x;
        }
    }
    evidence_cell(s.cell(), groups, p, {factor.data(), residual.data(), around, Scene::kStride},
                  s.log_lit.data(), s.log_foreground.data(),
                  {planes[7].data(), planes[8].data(), planes[9].data()});
    int undecided = 0;
    for (int x = 0; x < kCellPixels; ++x) {
        if (!(groups >> x / kGroupPixels & 1)) {
            for (int n = 7; n < 10; ++n) EXPECT_EQ(planes[n][x], kUntouched) << x;
            continue;
        }
        float step = 10.0f;
        for (const std::ptrdiff_t to : {-2 * Scene::kStride, std::ptrdiff_t{-2}, std::ptrdiff_t{0},
                                        std::ptrdiff_t{2}, 2 * Scene::kStride})
            step = std::min(step, std::abs(factor[x] - around[x + to]));
        const float expected = kde::evidence<kChannels>(
            &s.value[x], &s.reference[x], &s.scale[x], s.density[x], s.log_lit[s.density[x]], s.log_peak[x],
            residual[x], step, s.log_foreground[kde::histogram_bin<kChannels>(&s.value[x])], p);
        EXPECT_NEAR(planes[7][x], expected, 2e-4f * std::abs(expected) + 2e-4f) << x;
        const float distance = kde::squared_distance<kChannels>(&s.value[x], &s.reference[x], &s.scale[x]);
        EXPECT_NEAR(planes[8][x], distance, 1e-5f * distance) << x;
        EXPECT_EQ(planes[9][x], s.log_foreground[kde::histogram_bin<kChannels>(&s.value[x])]) << x;
        undecided += std::abs(expected) < p.limit;
    }
    if (groups == kde::kAllGroups) {
        EXPECT_GT(undecided, 5);
    }
}

TEST(SegmentationEvidence, VectorFormEqualsScalarFormAndKeepsOtherGroups) {
    for (const int groups : {kde::kAllGroups, 0, 1, 4, 9, 14}) {
        expect_scalar_values<1>(groups);
        expect_scalar_values<3>(groups);
    }
}

TEST(SegmentationEvidence, FindsGroupsNearUnsurePixels) {
    for (int x = 0; x < kCellPixels; ++x) {
        AlignedVector<std::uint8_t> density(kCellPixels, kde::kSureDensity);
        EXPECT_EQ(groups_near_unsure(density.data()), 0);
        density[x] = kde::kSureDensity - 1;
        const int groups = groups_near_unsure(density.data());
        // Every group with a pixel within the margin, none with all pixels beyond the margin's next slice.
        for (int g = -1; g <= kCellPixels / kGroupPixels; ++g) {
            const int first = g * kGroupPixels, last = first + kGroupPixels - 1;
            const int gap = std::max({first - x, x - last, 0});
            const int bit = g < 0                             ? kde::kNearLeft
                            : g == kCellPixels / kGroupPixels ? kde::kNearRight
                                                              : 1 << g;
            if (gap <= kde::kActiveMargin) {
                EXPECT_TRUE(groups & bit) << "pixel " << x << " group " << g;
            }
            if (gap >= 2 * kde::kActiveMargin) {
                EXPECT_FALSE(groups & bit) << "pixel " << x << " group " << g;
            }
        }
    }
    EXPECT_EQ(groups_of_cell(3, 0b0110).g0, 13);
    EXPECT_EQ(groups_of_cell(3, 0b0110).g1, 15);
}

}  // namespace
}  // namespace kinevox::kernels::cpu
