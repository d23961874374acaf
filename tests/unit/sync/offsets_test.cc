// Offsets of synthetic signals are found with sub-frame accuracy, and unreliable ones are refused.
#include "server/sync/offsets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

#include "server/sync/evidence.h"
#include "server/sync/offset_search.h"
#include "server/sync/signals.h"

namespace kinevox::sync {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr double kFps = 30;
using Movement = std::function<double(double t_s)>;

// A movement without repetition: waves whose periods have no common multiple.
double walk(double t, double phase) {
    double sum = 0;
    for (const double hertz : {0.213, 0.371, 0.613, 0.977, 1.618, 2.414})
        sum += std::sin(2 * std::numbers::pi * hertz * t + phase * (1 + 3 * hertz)) / (0.4 + hertz);
    return sum;
}

struct MadeCamera {
    double begins_s = 0, lasts_s = 8;
    Movement equal;  // px; null: none
    Movement alike;  // null: as all
};

class Made {
  public:
    explicit Made(std::vector<MadeCamera> cameras, double noise_px = 0.4) : cameras_(std::move(cameras)) {
        std::mt19937 random(3);  // the same numbers on every machine: the distribution below is ours
        const auto noise = [&] {
            double sum = 0;
            for (int i = 0; i < 12; ++i) sum += static_cast<double>(random()) / 4294967295.0;
            return sum - 6;
        };
        for (std::size_t a = 0; a < cameras_.size(); ++a)
            for (std::size_t b = a + 1; b < cameras_.size(); ++b) {
                PairSignals pair;
                pair.first = a, pair.second = b;
                // Each pair of cameras sees its own movement.
                const double phase = static_cast<double>(3 * a + b);
                const auto equal = [&](const MadeCamera& camera) {
                    return sampled(camera, [&](double t) {
                        return (camera.equal ? camera.equal(t) : 20 * walk(t, phase)) + noise_px * noise();
                    });
                };
                const auto alike = [&](const MadeCamera& camera, double gain) {
                    return sampled(camera, [&](double t) {
                        return gain * ((camera.alike ? camera.alike : whole_)(t) + 0.3 * noise());
                    });
                };
                if (with_equal) pair.equal_px.push_back({equal(cameras_[a]), equal(cameras_[b])});
                pair.alike.push_back({alike(cameras_[a], 1), alike(cameras_[b], 0.3)});
                pair.alike.push_back({alike(cameras_[a], 2), alike(cameras_[b], 5)});
                pairs.push_back(std::move(pair));
            }
    }
    static Made only_alike(std::vector<MadeCamera> cameras) {
        with_equal = false;
        Made made(std::move(cameras));
        with_equal = true;
        return made;
    }
    absl::StatusOr<OffsetSolution> solve(OffsetOptions options = {}) const {
        std::vector<PairEvidence> evidence;
        for (const PairSignals& pair : pairs) evidence.emplace_back(pair, EvidenceOptions{.fps = kFps});
        std::vector<std::string> names;
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            names.push_back(std::string(1, static_cast<char>('a' + c)));
        options.fps = kFps;
        return solve_offsets(evidence, names, options);
    }
    // Between the cameras' starts, both relative to their mean.
    double worst_error_frames(const OffsetSolution& found) const {
        double mean = 0, worst = 0;
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            mean += (found.cameras[c].offset_s - cameras_[c].begins_s) / static_cast<double>(cameras_.size());
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            worst = std::max(worst, std::abs(found.cameras[c].offset_s - cameras_[c].begins_s - mean) * kFps);
        return worst;
    }
    std::vector<PairSignals> pairs;

  private:
    template <class Value>
    static Signal sampled(const MadeCamera& camera, Value value) {
        Signal out;
        for (int n = 0; n < std::lround(camera.lasts_s * kFps); ++n)
            out.push_back(value(camera.begins_s + n / kFps));
        return out;
    }
    static inline bool with_equal = true;
    Movement whole_ = [](double t) { return walk(t, 0.5); };
    std::vector<MadeCamera> cameras_;
};

std::string message_of(const absl::StatusOr<OffsetSolution>& found) {
    EXPECT_EQ(found.status().code(), absl::StatusCode::kFailedPrecondition) << found.status();
    return std::string(found.status().message());
}

TEST(Offsets, FindsStartsToATenthOfAFrame) {
    const Made made({{0.5, 9}, {2.0 + 0.4 / kFps, 7}, {1.1 + 0.75 / kFps, 6}, {0.0, 5.5}});
    const auto found = made.solve();
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_LT(made.worst_error_frames(*found), 0.1);
    EXPECT_EQ(found->cameras[3].offset_s, 0) << "the earliest";
    for (const CameraFit& camera : found->cameras) {
        EXPECT_GT(camera.evidence, 100);
        EXPECT_LT(camera.std_s * kFps, 0.2);
        EXPECT_GT(camera.std_s, 0);
        EXPECT_LT(camera.runner_up, 0.8);
        // The curve's maximum is the solution.
        const auto top = std::ranges::max_element(camera.curve.evidence) - camera.curve.evidence.begin();
        EXPECT_LE(std::abs(camera.curve.lowest_frames + static_cast<int>(top)), 1);
    }
    EXPECT_EQ(found->pairs.size(), 6u);
}

TEST(Offsets, FindsStartsWithoutEqualSignals) {
    const Made made = Made::only_alike({{0.0, 9}, {1.5 + 0.5 / kFps, 8}, {0.7, 8}});
    const auto found = made.solve();
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_LT(made.worst_error_frames(*found), 0.3);
    EXPECT_FALSE(found->pairs[0].residual_px.has_value());
}

TEST(Offsets, UnaffectedByBiasAndGaps) {
    Made made({{0.0, 8}, {1.0 + 0.3 / kFps, 8}, {0.5, 8}});
    for (PairSignals& pair : made.pairs) {
        for (double& v : pair.equal_px[0][1]) v += 1;  // a slightly wrong calibration
        for (std::size_t n = 30; n < 60; ++n) pair.equal_px[0][0][n] = pair.alike[0][1][n] = std::nan("");
        for (std::size_t n = 100; n < 110; ++n)
            pair.equal_px[0][1][n] += 80;  // a silhouette without its head
    }
    const auto found = made.solve();
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_LT(made.worst_error_frames(*found), 0.25);
}

TEST(Offsets, DownWeightsAnOutlierPair) {
    Made made({{0.0, 8}, {1.0, 8}, {0.5, 8}, {0.2, 8}});
    for (std::array<Signal, 2>& signals : made.pairs[0].equal_px) {  // one frame late
        signals[1].insert(signals[1].begin(), signals[1].front());
        signals[1].pop_back();
    }
    const auto found = made.solve();
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_LT(made.worst_error_frames(*found), 0.2);
    EXPECT_LT(found->pairs[0].weight, 0.4);
    EXPECT_GT(std::abs(found->pairs[0].residual_frames), 0.5);
    EXPECT_GT(found->pairs[5].weight, 0.9);
}

TEST(Offsets, RefusesRepeatingMovementWithItsPeriod) {
    const auto steps = [](double t) {
        return 20 * std::sin(2 * std::numbers::pi * t / 1.2) + 8 * std::cos(4 * std::numbers::pi * t / 1.2);
    };
    const Made made({{0.0, 8, steps, steps}, {0.5, 8, steps, steps}, {0.3, 8, steps, steps}});
    EXPECT_THAT(message_of(made.solve()),
                AllOf(HasSubstr("two shifts"), HasSubstr("1.200 s apart"), HasSubstr("repeating movement")));
    // With only one candidate in range it is not ambiguous.
    const auto found = made.solve({.max_offset_s = 0.6});
    ASSERT_TRUE(found.ok()) << found.status();
    EXPECT_LT(made.worst_error_frames(*found), 0.2);
}

TEST(Offsets, FindsAmbiguityBetweenTwoGroups) {
    // Each pair has its own fast movement in view; the shared one repeats.
    const auto repeats = [](double t) { return 15 * std::sin(2 * std::numbers::pi * t / 1.5); };
    Made made({{0.0, 8, repeats, repeats},
               {0.5, 8, repeats, repeats},
               {0.3, 8, repeats, repeats},
               {0.9, 8, repeats, repeats}});
    const Made own({{0.0, 8}, {0.5, 8}, {0.3, 8}, {0.9, 8}});
    made.pairs[0] = own.pairs[0];  // a and b
    made.pairs[5] = own.pairs[5];  // c and d
    EXPECT_THAT(message_of(made.solve()), AllOf(HasSubstr("cameras "), HasSubstr("two shifts")));
}

TEST(Offsets, RefusesStaticScene) {
    const auto still = [](double) { return 5.0; };
    EXPECT_THAT(message_of(Made({{0.0, 8, still, still}, {0.5, 8, still, still}}).solve()),
                AllOf(HasSubstr("no shift up to 30 s"), HasSubstr("No person moves")));
}

TEST(Offsets, NamesCameraOfAnotherRecording) {
    const auto other = [](double t) { return 20 * walk(3.1 * t + 70, 2.2); };
    EXPECT_THAT(message_of(Made({{0.0, 8}, {0.5, 8}, {0.3, 8, other, other}, {1, 8}}).solve()),
                AllOf(HasSubstr("camera c:"),
                      ::testing::AnyOf(HasSubstr("another recording"), HasSubstr("two shifts"))));
}

TEST(Offsets, RefusesSlowDrift) {
    const auto drifts = [](double t) { return 3 * std::sin(0.4 * t); };
    const auto message =
        message_of(Made({{0.0, 12, drifts, drifts}, {0.5, 12, drifts, drifts}}, 0.3).solve());
    EXPECT_THAT(message,
                ::testing::AnyOf(HasSubstr("too slow"), HasSubstr("no shift"), HasSubstr("two shifts")));
}

TEST(Offsets, RefusesOffsetsBeyondTheMaximum) {
    const Made made({{0.0, 10}, {3.0, 10}, {0.4, 10}});
    ASSERT_TRUE(made.solve().ok());
    EXPECT_THAT(message_of(made.solve({.max_offset_s = 1})), HasSubstr("up to 1 s"));
}

TEST(Offsets, RefusesWrongExtrinsics) {
    Made made({{0.0, 8}, {0.5, 8}, {0.3, 8}});
    for (PairSignals& pair : made.pairs)
        for (double& v : pair.equal_px[0][1]) v += 12;
    EXPECT_THAT(message_of(made.solve()),
                ::testing::AnyOf(HasSubstr("extrinsics"), HasSubstr("no shift"), HasSubstr("two shifts")));
}

TEST(PairEvidence, EmptySignalsGiveNoEvidence) {
    PairSignals empty;
    empty.second = 1;
    empty.equal_px.push_back({Signal(50, std::nan("")), Signal(50, 1.0)});
    empty.alike.push_back({Signal(), Signal(50, 1.0)});
    PairEvidence evidence(empty, {});
    evidence.tabulate(-100, 100);
    for (int lag = -100; lag <= 100; ++lag) EXPECT_EQ(evidence.at(lag), 0) << lag;
    EXPECT_EQ(evidence.between(0.5), 0);
    EXPECT_FALSE(evidence.residual_px(0).has_value());
}

// A table's entries equal a plain sum over the images.
TEST(PairEvidence, TableEqualsPlainSum) {
    const Made made({{0.0, 3}, {0.4, 4}});
    PairSignals pair = made.pairs[0];
    pair.alike.clear();
    pair.equal_px[0][0][7] = std::nan("");
    PairEvidence evidence(pair, {.fps = kFps});
    evidence.tabulate(-500, 500);
    EXPECT_EQ(evidence.lowest(), 1 - static_cast<int>(pair.equal_px[0][1].size()));
    EXPECT_EQ(evidence.highest(), static_cast<int>(pair.equal_px[0][0].size()) - 1);
    const auto& [x, y] = pair.equal_px[0];
    double chance = 0, count = 0;
    for (const double a : x)
        for (const double b : y)
            if (!std::isnan(a)) chance -= std::log1p((a - b) * (a - b) / 4), ++count;
    for (const int lag : {-40, -12, 0, 12, 33}) {
        double sum = 0;
        int overlap = 0;
        for (int n = 0; n < static_cast<int>(x.size()); ++n) {
            const int m = n - lag;
            if (m < 0 || m >= static_cast<int>(y.size()) || std::isnan(x[n])) continue;
            sum += -std::log1p((x[n] - y[m]) * (x[n] - y[m]) / 4) - chance / count;
            ++overlap;
        }
        EXPECT_NEAR(evidence.at(lag), sum / 3, 1e-6) << lag;  // a tenth of a second: three frames
        EXPECT_EQ(evidence.overlap(lag), overlap);
    }
}

TEST(Signals, SmoothingKeepsLinesAndGaps) {
    Signal line;
    for (int n = 0; n < 40; ++n) line.push_back(n == 20 ? std::nan("") : 2.0 * n);
    const Signal smooth = smoothed(line, 1.5);
    EXPECT_TRUE(std::isnan(smooth[20]));
    for (int n = 6; n < 14; ++n) EXPECT_NEAR(smooth[n], 2.0 * n, 1e-9);
}

}  // namespace
}  // namespace kinevox::sync
