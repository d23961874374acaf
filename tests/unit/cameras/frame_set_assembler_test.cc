// Frame sets from cameras whose clocks differ, that lose images, come late, go away and come back.
#include "server/cameras/frame_set_assembler.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <optional>
#include <random>
#include <vector>

namespace kinevox {
namespace {

constexpr double kMs = 1e6;
constexpr std::int64_t kSteady0 = 5'000'000'000'000;  // of the daemon's clock when the tests begin

Image some_image() {
    static const std::shared_ptr<const std::uint8_t[]> data = std::make_shared<std::uint8_t[]>(3);
    return {1, 1, 3, data};
}

// Simulated cameras that expose simultaneously, and a network.
class Rig {
  public:
    struct Eye {
        double offset_ms = 0, drift_ppm = 0;  // of its clock
        double phase_ms = 0;                  // it takes its image so much later
        double delay_ms = 5;                  // every image's, at least
        double unsteady_ms = 0;               // its images are so much early or late at most
    };

    explicit Rig(std::vector<Eye> eyes, FrameSetAssemblerOptions options = {}) : eyes_(std::move(eyes)) {
        options.camera_count = eyes_.size();
        assembler.emplace(options);
        period_ms_ = 1000 / options.fps;
        for (std::size_t c = 0; c < eyes_.size(); ++c) assembler->connect(c);
        number_.resize(eyes_.size(), 0);
    }

    // Instant `n`: each camera sends its image. run() delivers them in the order of arrival.
    void shoot(int n, const std::function<double(std::size_t)>& more_delay_ms = {},
               const std::function<bool(std::size_t)>& arrives = {}) {
        for (std::size_t c = 0; c < eyes_.size(); ++c) {
            const double taken_ms =
                n * period_ms_ + eyes_[c].phase_ms + eyes_[c].unsteady_ms * wobble_(random_);
            const std::uint64_t number = ++number_[c];
            if (arrives && !arrives(c)) continue;
            const double arrival_ms = taken_ms + eyes_[c].delay_ms + (more_delay_ms ? more_delay_ms(c) : 0);
            const double shown_ms = eyes_[c].offset_ms + taken_ms * (1 + eyes_[c].drift_ppm * 1e-6);
            sent_.push_back({c, number, clock, std::llround(shown_ms * kMs),
                             kSteady0 + std::llround(arrival_ms * kMs), some_image()});
        }
    }

    // Everything that arrives, in order; of one camera in the order of sending, as a stream hands it out.
    std::vector<FrameSet> run(bool to_the_end = true) {
        std::vector<std::int64_t> last(eyes_.size(), 0);
        std::vector<std::pair<std::int64_t, ArrivedImage>> order;
        for (ArrivedImage& p : sent_) {
            last[p.camera] = std::max(last[p.camera], p.arrival_ns);
            order.emplace_back(last[p.camera], std::move(p));
        }
        sent_.clear();
        std::ranges::stable_sort(order, {}, &std::pair<std::int64_t, ArrivedImage>::first);
        std::vector<FrameSet> sets;
        const auto take = [&](std::int64_t now) {
            while (auto set = assembler->take(now)) {
                took_at.push_back(now);
                sets.push_back(std::move(*set));
            }
        };
        for (auto& [now, image] : order) {
            while (assembler->due_ns() && *assembler->due_ns() < now) {
                const auto due = *assembler->due_ns();
                take(due);
            }
            assembler->add(std::move(image));
            take(now);
        }
        while (to_the_end && assembler->due_ns()) take(*assembler->due_ns());
        return sets;
    }

    CameraConnection link(std::size_t camera) const {
        CameraConnection link;
        assembler->fill(camera, link);
        return link;
    }

    TimestampSource clock = TimestampSource::kDevice;
    std::optional<FrameSetAssembler> assembler;
    std::vector<std::int64_t> took_at;

  private:
    std::vector<Eye> eyes_;
    double period_ms_ = 0;
    std::mt19937 random_{4};
    std::uniform_real_distribution<double> wobble_{-1, 1};
    std::vector<std::uint64_t> number_;
    std::vector<ArrivedImage> sent_;
};

int images_in(const FrameSet& set) {
    return static_cast<int>(std::ranges::count_if(set.images, [](const Image& p) { return !p.empty(); }));
}

void expect_rising(const std::vector<FrameSet>& sets) {
    for (std::size_t n = 1; n < sets.size(); ++n) {
        EXPECT_GT(sets[n].sequence, sets[n - 1].sequence);
        EXPECT_GT(sets[n].capture_time_ns, sets[n - 1].capture_time_ns);
    }
}

TEST(FrameSets, MatchesCamerasWithDifferentClocks) {
    Rig rig({{.offset_ms = 0}, {.offset_ms = 1e9}, {.offset_ms = -777, .delay_ms = 6}, {.offset_ms = 12.3}});
    for (int n = 0; n < 100; ++n) rig.shoot(n);
    const auto sets = rig.run();
    ASSERT_EQ(sets.size(), 100u - (ClockEstimate::kSettled - 1));
    for (std::size_t n = 0; n < sets.size(); ++n) {
        EXPECT_EQ(images_in(sets[n]), 4);
        EXPECT_EQ(sets[n].sequence, n);
    }
    EXPECT_EQ(rig.link(1).warmup_image_count, ClockEstimate::kSettled - 1u);
    EXPECT_EQ(rig.link(1).image_count, sets.size());
    EXPECT_NEAR(rig.link(2).mean_skew_ms - rig.link(0).mean_skew_ms, 1, 0.01)
        << "what its larger delay makes of it";
    EXPECT_NEAR(rig.link(2).mean_arrival_delay_ms, 1, 0.01);
}

// Ten minutes with quartzes that are as bad as they get, and 50 ms of jitter.
TEST(FrameSets, DriftAndJitterLoseNoImages) {
    Rig rig({{.drift_ppm = 0}, {.offset_ms = 400, .drift_ppm = 100}, {.drift_ppm = -100}, {.drift_ppm = 30}});
    std::mt19937 random(1);
    std::uniform_real_distribution<double> jitter_ms(0, 50);
    const int kFrames = 18000;
    for (int n = 0; n < kFrames; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_GE(sets.size(), kFrames - 12u);
    const auto incomplete =
        std::ranges::count_if(sets, [](const FrameSet& set) { return images_in(set) < 4; });
    EXPECT_LE(incomplete, 4) << "while the first clocks are learned";
    EXPECT_LE(sets.back().sequence + 1 - sets.size(), 0u) << "no gap";
    expect_rising(sets);
    EXPECT_NEAR(rig.link(1).clock_drift_ppm - rig.link(0).clock_drift_ppm, 100, 25);
    EXPECT_NEAR(rig.link(2).clock_drift_ppm - rig.link(0).clock_drift_ppm, -100, 25);
    for (std::size_t c = 0; c < 4; ++c) EXPECT_LT(std::abs(rig.link(c).mean_skew_ms), 3) << "camera " << c;
    EXPECT_GT(rig.link(0).max_arrival_delay_ms, 20) << "the jitter shows as lateness, not as skew";
}

TEST(FrameSets, CountsLossesWithoutLongDelay) {
    Rig rig(std::vector<Rig::Eye>(4));
    std::mt19937 random(2);
    std::vector<std::uint64_t> lost(4, 0);
    for (int n = 0; n < 3000; ++n)
        rig.shoot(n, {}, [&](std::size_t c) {
            const bool arrives = n < 10 || n > 2990 || random() % 50 != 0;
            if (!arrives) ++lost[c];
            return arrives;
        });
    const auto sets = rig.run();
    expect_rising(sets);
    EXPECT_EQ(sets.size(), 3000u - 7);
    for (std::size_t c = 0; c < 4; ++c) {
        EXPECT_GT(lost[c], 30u);
        EXPECT_EQ(rig.link(c).lost_image_count, lost[c]);
        EXPECT_EQ(rig.link(c).image_count + rig.link(c).lost_image_count + rig.link(c).warmup_image_count,
                  3000u);
    }
    // The camera's next image implies that this one is lost.
    for (std::size_t n = 0; n + 1 < sets.size(); ++n)
        EXPECT_LE(rig.took_at[n] - sets[n].capture_time_ns,
                  std::llround(2 * 33.4 * kMs) + std::llround(6 * kMs));
}

TEST(FrameSets, CountsIncompleteImages) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 20; ++n) rig.shoot(n);
    auto sets = rig.run(false);
    // The camera's own numbers and time continue.
    const std::int64_t time_ns = std::llround(20 * 1000.0 / 30 * kMs);
    for (std::size_t c = 0; c < 3; ++c)
        rig.assembler->add({c, 21, TimestampSource::kDevice, time_ns,
                            kSteady0 + time_ns + std::llround(5 * kMs), c == 1 ? Image{} : some_image()});
    const auto set = rig.assembler->take(kSteady0 + time_ns + std::llround(5 * kMs));
    ASSERT_TRUE(set) << "does not wait for a failed image";
    EXPECT_EQ(images_in(*set), 2);
    EXPECT_TRUE(set->images[1].empty());
    EXPECT_EQ(rig.link(1).incomplete_image_count, 1u);
    EXPECT_EQ(rig.link(1).lost_image_count, 0u);
}

TEST(FrameSets, CountsImagesWithoutTime) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 20; ++n) rig.shoot(n);
    const std::size_t before = rig.run().size();
    rig.assembler->add(
        {1, 21, TimestampSource::kUnknown, 0, kSteady0 + std::llround(20.5 * 1000 / 30 * kMs), {}});
    rig.shoot(20, {}, [](std::size_t c) { return c != 1; });
    rig.shoot(21);
    const auto sets = rig.run();
    ASSERT_EQ(sets.size(), 2u);
    EXPECT_EQ(images_in(sets[0]), 2);
    EXPECT_EQ(images_in(sets[1]), 3);
    EXPECT_EQ(rig.link(1).incomplete_image_count, 1u);
    EXPECT_EQ(rig.link(1).lost_image_count, 0u);
    EXPECT_EQ(rig.link(1).image_count, before + 1);
    EXPECT_EQ(rig.link(1).timestamp_source, TimestampSource::kDevice);
}

TEST(FrameSets, EndedCameraDelaysOthersOnlyOnce) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 60; ++n) rig.shoot(n, {}, [&](std::size_t c) { return c != 2 || n < 30; });
    auto sets = rig.run(false);
    const std::size_t before = sets.size();
    for (std::size_t n = 0; n < before; ++n) {
        EXPECT_LE(rig.took_at[n] - sets[n].capture_time_ns, std::llround(201 * kMs)) << n;
        EXPECT_LE(rig.took_at[n] - rig.took_at[n > 0 ? n - 1 : 0], std::llround(236 * kMs)) << n;
    }
    rig.assembler->disconnect(2);
    rig.took_at.clear();
    for (int n = 60; n < 90; ++n) rig.shoot(n, {}, [&](std::size_t c) { return c != 2; });
    sets = rig.run();
    for (std::size_t n = 10; n < sets.size(); ++n)
        EXPECT_LE(rig.took_at[n] - sets[n].capture_time_ns, std::llround(5.1 * kMs));
    EXPECT_EQ(images_in(sets.back()), 2);
    EXPECT_EQ(sets.back().sequence, 89u - 7);
    // It reconnects with a restarted clock.
    rig.assembler->connect(2);
    for (int n = 90; n < 130; ++n) {
        const std::int64_t time_ns = std::llround(n * 1000.0 / 30 * kMs);
        const std::int64_t arrival_ns = kSteady0 + time_ns + std::llround(5 * kMs);
        for (std::size_t c = 0; c < 3; ++c)
            rig.assembler->add({c, c == 2 ? n - 89u : n + 1u, TimestampSource::kDevice,
                                c == 2 ? time_ns - std::llround(2900 * kMs) : time_ns, arrival_ns,
                                some_image()});
        const auto set = rig.assembler->take(arrival_ns);
        ASSERT_TRUE(set);
        EXPECT_EQ(images_in(*set), n < 90 + ClockEstimate::kSettled - 1 ? 2 : 3) << n;
    }
    EXPECT_EQ(rig.link(2).lost_image_count, 0u) << "images while disconnected do not count";
}

TEST(FrameSets, LateImageDoesNotJoinNextSet) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 100; ++n)
        rig.shoot(n, [&](std::size_t c) {
            return c == 1 && n == 50 ? 290.0 : 0.0;
        });  // and holds up those behind it
    const auto sets = rig.run();
    expect_rising(sets);
    EXPECT_EQ(sets.size(), 100u - 7) << "no set more, none less";
    EXPECT_GE(rig.link(1).late_image_count, 1u);
    EXPECT_LE(rig.link(1).late_image_count, 3u);
    EXPECT_EQ(rig.link(1).image_count + rig.link(1).late_image_count + rig.link(1).warmup_image_count, 100u);
    for (const FrameSet& set : sets)
        for (std::size_t c = 0; c < 3; ++c) {
            if (set.images[c].empty()) continue;
            EXPECT_LT(std::abs(set.image_times_ns[c] - set.capture_time_ns), std::llround(1 * kMs));
        }
}

TEST(FrameSets, MatchesFreeRunningCamerasWithinTolerance) {
    FrameSetAssemblerOptions options;
    options.match_tolerance_ms = 0.9 * 1000 / 30;
    Rig rig({{.phase_ms = 0, .unsteady_ms = 1.5},
             {.phase_ms = 11, .unsteady_ms = 1.5},
             {.phase_ms = 22},
             {.phase_ms = 26}},
            options);
    for (int n = 0; n < 300; ++n) rig.shoot(n);
    const auto sets = rig.run();
    const auto complete =
        std::ranges::count_if(sets, [](const FrameSet& set) { return images_in(set) == 4; });
    EXPECT_GE(complete, 290);
    EXPECT_LE(sets.size(), 300u);
    for (std::size_t c = 0; c < 4; ++c) EXPECT_EQ(rig.link(c).late_image_count, 0u) << c;
    EXPECT_GT(rig.link(0).max_abs_skew_ms + rig.link(3).max_abs_skew_ms, 10) << "the skew is reported";
}

TEST(FrameSets, MissingInstantIsSequenceGap) {
    Rig rig(std::vector<Rig::Eye>(2));
    for (int n = 0; n < 60; ++n) rig.shoot(n, {}, [&](std::size_t) { return n < 30 || n >= 35; });
    const auto sets = rig.run();
    EXPECT_EQ(sets.size(), 60u - 5 - 7);
    EXPECT_EQ(sets.back().sequence, 59u - 7);
}

TEST(FrameSets, DropsSetsWithTooFewImages) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 60; ++n)
        rig.shoot(n, {}, [&](std::size_t c) { return c == 0 || n % 2 == 0 || n < 8; });
    const auto sets = rig.run();
    for (const FrameSet& set : sets) EXPECT_EQ(images_in(set), 3);
    EXPECT_GE(rig.link(0).unmatched_image_count, 25u);
    EXPECT_EQ(rig.link(0).image_count + rig.link(0).unmatched_image_count + rig.link(0).warmup_image_count,
              60u);
}

TEST(FrameSets, PtpCamerasShareOneEstimate) {
    Rig rig({{.delay_ms = 2}, {.delay_ms = 14}, {.delay_ms = 9}});
    rig.clock = TimestampSource::kPtp;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> jitter_ms(0, 3);
    for (int n = 0; n < 100; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_GE(sets.size(), 95u);
    EXPECT_NEAR(rig.link(1).max_abs_skew_ms, 0, 0.001)
        << "neither its longer delay nor the jitter is any of its time";
    EXPECT_GT(rig.link(1).mean_arrival_delay_ms, 8);
    EXPECT_EQ(rig.link(1).timestamp_source, TimestampSource::kPtp);
}

TEST(FrameSets, UsesArrivalWithoutTimestamps) {
    Rig rig(std::vector<Rig::Eye>(3));
    rig.clock = TimestampSource::kArrival;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> jitter_ms(0, 4);
    for (int n = 0; n < 300; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_EQ(sets.size(), 300u);
    for (const FrameSet& set : sets) EXPECT_EQ(images_in(set), 3);
}

TEST(FrameSets, ReestimatesClockAfterStep) {
    ClockEstimate clock;
    for (int n = 0; n < 100; ++n) clock.add(n * 33'000'000LL, kSteady0 + n * 33'000'000LL + 1'000'000);
    EXPECT_TRUE(clock.settled());
    EXPECT_EQ(clock.add(7, kSteady0 + 100 * 33'000'000LL), kSteady0 + 100 * 33'000'000LL)
        << "the counter restarted";
    EXPECT_FALSE(clock.settled());
}

}  // namespace
}  // namespace kinevox
