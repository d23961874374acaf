#include "kernels/moment_search.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace kinevox::kernels {
namespace {

// Scores by the definition: interpolate the codes, then subtract.
float score(const std::vector<std::uint8_t>& codes, int pose, int heading, const std::uint8_t* query,
            double first_bin) {
    double place = first_bin + 0.5 * heading;
    place -= std::floor(place / kViewBins) * kViewBins;
    const int a = static_cast<int>(place) % kViewBins, b = (a + 1) % kViewBins;
    const double w = place - std::floor(place);
    double sum = 0;
    for (int n = 0; n < kCodeBytes; ++n) {
        const double va = codes[(pose * kViewBins + a) * kCodeBytes + n];
        const double vb = codes[(pose * kViewBins + b) * kCodeBytes + n];
        sum += std::pow((1 - w) * va + w * vb - query[n], 2);
    }
    return static_cast<float>(sum);
}

TEST(MomentSearch, ScoresMatchDefinition) {
    std::mt19937 random(7);
    for (const int poses : {1, 2, 9}) {
        std::vector<std::uint8_t> codes(static_cast<std::size_t>(poses) * kViewBins * kCodeBytes);
        for (std::uint8_t& byte : codes)
            byte = random() % 16 == 0 ? 127 : static_cast<std::uint8_t>(random() % 128);
        const MomentSlab slab = MomentSlab::make(codes);
        std::uint8_t query[2][kCodeBytes];
        for (auto& q : query)
            for (std::uint8_t& byte : q) byte = static_cast<std::uint8_t>(random() % 128);
        for (const double first_bin : {0.0, 3.25, -17.6, 35.9999, 1e4 + 0.3}) {
            std::vector<float> scores(static_cast<std::size_t>(poses) * kHeadings, 7.f);
            const MomentQuery queries[2] = {{&slab, query[0], first_bin}, {&slab, query[1], -first_bin}};
            score_headings(queries, scores);
            for (int pose = 0; pose < poses; ++pose)
                for (int h = 0; h < kHeadings; ++h) {
                    const float expected = 0.5f * score(codes, pose, h, query[0], first_bin) +
                                           0.5f * score(codes, pose, h, query[1], -first_bin);
                    EXPECT_NEAR(scores[pose * kHeadings + h], expected, 1e-5f * expected + 0.5f);
                }
        }
    }
}

TEST(MomentSearch, HandlesEmptyAndRejectsInvalidInput) {
    const MomentSlab none = MomentSlab::make({});
    const std::uint8_t code[kCodeBytes] = {};
    const MomentQuery query{&none, code, 0};
    score_headings(std::span(&query, 1), {});
    EXPECT_THROW(score_headings({}, {}), std::invalid_argument);
    std::vector<std::uint8_t> codes(kViewBins * kCodeBytes, 0);
    codes[5] = 128;
    EXPECT_THROW(MomentSlab::make(codes), std::invalid_argument);
    codes.pop_back();
    EXPECT_THROW(MomentSlab::make(codes), std::invalid_argument);
    std::vector<float> scores(kHeadings);
    EXPECT_THROW(score_headings(std::span(&query, 1), scores), std::invalid_argument);
}

TEST(MomentSearch, BlendedDistanceEqualsDistanceToBlend) {
    std::mt19937 random(3);
    for (const int values : {1, 8, 121}) {
        std::vector<float> query(values);
        std::vector<std::int16_t> a(values), b(values);
        double expected = 0;
        for (int v = 0; v < values; ++v) {
            query[v] = 0.001f * static_cast<float>(random() % 2000);
            a[v] = static_cast<std::int16_t>(random()), b[v] = static_cast<std::int16_t>(random());
            expected += std::pow(query[v] - 3e-5 * a[v] - 1e-5 * b[v], 2);
        }
        EXPECT_NEAR(blended_distance(query.data(), a.data(), b.data(), 3e-5f, 1e-5f, values), expected,
                    1e-5 * expected);
    }
}

}  // namespace
}  // namespace kinevox::kernels
