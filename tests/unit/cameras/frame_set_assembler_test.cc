// Frame sets from cameras whose clocks differ, that lose pictures, come late, go away and come back.
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

Picture some_picture() {
    static const std::shared_ptr<const std::uint8_t[]> data = std::make_shared<std::uint8_t[]>(3);
    return {1, 1, 3, data};
}

// Cameras that see the same moments, and a network.
class Rig {
  public:
    struct Eye {
        double offset_ms = 0, drift_ppm = 0;  // of its clock
        double phase_ms = 0;                  // it takes its picture so much later
        double delay_ms = 5;                  // every picture's, at least
        double unsteady_ms = 0;               // its pictures are so much early or late at most
    };

    explicit Rig(std::vector<Eye> eyes, FrameSetAssemblerOptions options = {}) : eyes_(std::move(eyes)) {
        options.cameras = eyes_.size();
        assembler.emplace(options);
        period_ms_ = 1000 / options.fps;
        for (std::size_t c = 0; c < eyes_.size(); ++c) assembler->connect(c);
        number_.resize(eyes_.size(), 0);
    }

    // The moment `n`: each camera's picture is sent. Arrivals come in their order with run().
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
                             kSteady0 + std::llround(arrival_ms * kMs), some_picture()});
        }
    }

    // Everything that arrives, in order; of one camera in the order of sending, as a stream hands it out.
    std::vector<FrameSet> run(bool to_the_end = true) {
        std::vector<std::int64_t> last(eyes_.size(), 0);
        std::vector<std::pair<std::int64_t, ArrivedPicture>> order;
        for (ArrivedPicture& p : sent_) {
            last[p.camera] = std::max(last[p.camera], p.arrival_ns);
            order.emplace_back(last[p.camera], std::move(p));
        }
        sent_.clear();
        std::ranges::stable_sort(order, {}, &std::pair<std::int64_t, ArrivedPicture>::first);
        std::vector<FrameSet> sets;
        const auto take = [&](std::int64_t now) {
            while (auto set = assembler->take(now)) {
                took_at.push_back(now);
                sets.push_back(std::move(*set));
            }
        };
        for (auto& [now, picture] : order) {
            while (assembler->due_ns() && *assembler->due_ns() < now) {
                const auto due = *assembler->due_ns();
                take(due);
            }
            assembler->add(std::move(picture));
            take(now);
        }
        while (to_the_end && assembler->due_ns()) take(*assembler->due_ns());
        return sets;
    }

    CameraLink link(std::size_t camera) const {
        CameraLink link;
        assembler->fill(camera, link);
        return link;
    }

    CameraClock clock = CameraClock::kDevice;
    std::optional<FrameSetAssembler> assembler;
    std::vector<std::int64_t> took_at;

  private:
    std::vector<Eye> eyes_;
    double period_ms_ = 0;
    std::mt19937 random_{4};
    std::uniform_real_distribution<double> wobble_{-1, 1};
    std::vector<std::uint64_t> number_;
    std::vector<ArrivedPicture> sent_;
};

int pictures_in(const FrameSet& set) {
    return static_cast<int>(std::ranges::count_if(set.pictures, [](const Picture& p) { return !p.empty(); }));
}

void expect_rising(const std::vector<FrameSet>& sets) {
    for (std::size_t n = 1; n < sets.size(); ++n) {
        EXPECT_GT(sets[n].sequence, sets[n - 1].sequence);
        EXPECT_GT(sets[n].capture_time_ns, sets[n - 1].capture_time_ns);
    }
}

TEST(FrameSets, ClocksThatDifferAreBroughtTogether) {
    Rig rig({{.offset_ms = 0}, {.offset_ms = 1e9}, {.offset_ms = -777, .delay_ms = 6}, {.offset_ms = 12.3}});
    for (int n = 0; n < 100; ++n) rig.shoot(n);
    const auto sets = rig.run();
    ASSERT_EQ(sets.size(), 100u - (ClockEstimate::kSettled - 1));
    for (std::size_t n = 0; n < sets.size(); ++n) {
        EXPECT_EQ(pictures_in(sets[n]), 4);
        EXPECT_EQ(sets[n].sequence, n);
    }
    EXPECT_EQ(rig.link(1).settling, ClockEstimate::kSettled - 1u);
    EXPECT_EQ(rig.link(1).pictures, sets.size());
    EXPECT_NEAR(rig.link(2).skew_ms - rig.link(0).skew_ms, 1, 0.01) << "what its larger delay makes of it";
    EXPECT_NEAR(rig.link(2).lateness_ms, 1, 0.01);
}

// Ten minutes with quartzes that are as bad as they get, and 50 ms of jitter.
TEST(FrameSets, DriftAndJitterLoseNothing) {
    Rig rig({{.drift_ppm = 0}, {.offset_ms = 400, .drift_ppm = 100}, {.drift_ppm = -100}, {.drift_ppm = 30}});
    std::mt19937 random(1);
    std::uniform_real_distribution<double> jitter_ms(0, 50);
    const int kFrames = 18000;
    for (int n = 0; n < kFrames; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_GE(sets.size(), kFrames - 12u);
    const auto incomplete =
        std::ranges::count_if(sets, [](const FrameSet& set) { return pictures_in(set) < 4; });
    EXPECT_LE(incomplete, 4) << "while the first clocks are learned";
    EXPECT_LE(sets.back().sequence + 1 - sets.size(), 0u) << "no gap";
    expect_rising(sets);
    EXPECT_NEAR(rig.link(1).clock_drift_ppm - rig.link(0).clock_drift_ppm, 100, 25);
    EXPECT_NEAR(rig.link(2).clock_drift_ppm - rig.link(0).clock_drift_ppm, -100, 25);
    for (std::size_t c = 0; c < 4; ++c) EXPECT_LT(std::abs(rig.link(c).skew_ms), 3) << "camera " << c;
    EXPECT_GT(rig.link(0).lateness_max_ms, 20) << "the jitter shows as lateness, not as skew";
}

TEST(FrameSets, EveryLossIsCountedAndDelaysNobodyForLong) {
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
        EXPECT_EQ(rig.link(c).lost, lost[c]);
        EXPECT_EQ(rig.link(c).pictures + rig.link(c).lost + rig.link(c).settling, 3000u);
    }
    // The next picture of the camera tells that this one does not come.
    for (std::size_t n = 0; n + 1 < sets.size(); ++n)
        EXPECT_LE(rig.took_at[n] - sets[n].capture_time_ns,
                  std::llround(2 * 33.4 * kMs) + std::llround(6 * kMs));
}

TEST(FrameSets, WhatArrivedIncompleteIsMarkedAndCounted) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 20; ++n) rig.shoot(n);
    auto sets = rig.run(false);
    // The camera's own numbers and time go on.
    const std::int64_t time_ns = std::llround(20 * 1000.0 / 30 * kMs);
    for (std::size_t c = 0; c < 3; ++c)
        rig.assembler->add({c, 21, CameraClock::kDevice, time_ns, kSteady0 + time_ns + std::llround(5 * kMs),
                            c == 1 ? Picture{} : some_picture()});
    const auto set = rig.assembler->take(kSteady0 + time_ns + std::llround(5 * kMs));
    ASSERT_TRUE(set) << "nobody waits for a picture that has failed";
    EXPECT_EQ(pictures_in(*set), 2);
    EXPECT_TRUE(set->pictures[1].empty());
    EXPECT_EQ(rig.link(1).incomplete, 1u);
    EXPECT_EQ(rig.link(1).lost, 0u);
}

TEST(FrameSets, WhatArrivedWithoutItsTimeIsCountedAndDisturbsNobody) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 20; ++n) rig.shoot(n);
    const std::size_t before = rig.run().size();
    rig.assembler->add(
        {1, 21, CameraClock::kUnknown, 0, kSteady0 + std::llround(20.5 * 1000 / 30 * kMs), {}});
    rig.shoot(20, {}, [](std::size_t c) { return c != 1; });
    rig.shoot(21);
    const auto sets = rig.run();
    ASSERT_EQ(sets.size(), 2u);
    EXPECT_EQ(pictures_in(sets[0]), 2);
    EXPECT_EQ(pictures_in(sets[1]), 3);
    EXPECT_EQ(rig.link(1).incomplete, 1u);
    EXPECT_EQ(rig.link(1).lost, 0u);
    EXPECT_EQ(rig.link(1).pictures, before + 1);
    EXPECT_EQ(rig.link(1).clock, CameraClock::kDevice);
}

TEST(FrameSets, ACameraThatEndsDelaysTheOthersByTheLongestWaitAndThenNotAtAll) {
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
    EXPECT_EQ(pictures_in(sets.back()), 2);
    EXPECT_EQ(sets.back().sequence, 89u - 7);
    // It comes back with a clock that began anew.
    rig.assembler->connect(2);
    for (int n = 90; n < 130; ++n) {
        const std::int64_t time_ns = std::llround(n * 1000.0 / 30 * kMs);
        const std::int64_t arrival_ns = kSteady0 + time_ns + std::llround(5 * kMs);
        for (std::size_t c = 0; c < 3; ++c)
            rig.assembler->add({c, c == 2 ? n - 89u : n + 1u, CameraClock::kDevice,
                                c == 2 ? time_ns - std::llround(2900 * kMs) : time_ns, arrival_ns,
                                some_picture()});
        const auto set = rig.assembler->take(arrival_ns);
        ASSERT_TRUE(set);
        EXPECT_EQ(pictures_in(*set), n < 90 + ClockEstimate::kSettled - 1 ? 2 : 3) << n;
    }
    EXPECT_EQ(rig.link(2).lost, 0u) << "what it took meanwhile was sent to nobody";
}

TEST(FrameSets, APictureBehindItsSetIsLateNotInTheNext) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 100; ++n)
        rig.shoot(n, [&](std::size_t c) {
            return c == 1 && n == 50 ? 290.0 : 0.0;
        });  // and holds up those behind it
    const auto sets = rig.run();
    expect_rising(sets);
    EXPECT_EQ(sets.size(), 100u - 7) << "no set more, none less";
    EXPECT_GE(rig.link(1).late, 1u);
    EXPECT_LE(rig.link(1).late, 3u);
    EXPECT_EQ(rig.link(1).pictures + rig.link(1).late + rig.link(1).settling, 100u);
    for (const FrameSet& set : sets)
        for (std::size_t c = 0; c < 3; ++c) {
            if (set.pictures[c].empty()) continue;
            EXPECT_LT(std::abs(set.picture_times_ns[c] - set.capture_time_ns), std::llround(1 * kMs));
        }
}

TEST(FrameSets, CamerasThatRunFreeAreJoinedWithinTheTolerance) {
    FrameSetAssemblerOptions options;
    options.tolerance_ms = 0.9 * 1000 / 30;
    Rig rig({{.phase_ms = 0, .unsteady_ms = 1.5},
             {.phase_ms = 11, .unsteady_ms = 1.5},
             {.phase_ms = 22},
             {.phase_ms = 26}},
            options);
    for (int n = 0; n < 300; ++n) rig.shoot(n);
    const auto sets = rig.run();
    const auto complete =
        std::ranges::count_if(sets, [](const FrameSet& set) { return pictures_in(set) == 4; });
    EXPECT_GE(complete, 290);
    EXPECT_LE(sets.size(), 300u);
    for (std::size_t c = 0; c < 4; ++c) EXPECT_EQ(rig.link(c).late, 0u) << c;
    EXPECT_GT(rig.link(0).skew_max_ms + rig.link(3).skew_max_ms, 10) << "and the skew is told";
}

TEST(FrameSets, AMomentThatNobodySentIsAGapInTheSequence) {
    Rig rig(std::vector<Rig::Eye>(2));
    for (int n = 0; n < 60; ++n) rig.shoot(n, {}, [&](std::size_t) { return n < 30 || n >= 35; });
    const auto sets = rig.run();
    EXPECT_EQ(sets.size(), 60u - 5 - 7);
    EXPECT_EQ(sets.back().sequence, 59u - 7);
}

TEST(FrameSets, ASetWithTooFewPicturesIsNotHandedOut) {
    Rig rig(std::vector<Rig::Eye>(3));
    for (int n = 0; n < 60; ++n)
        rig.shoot(n, {}, [&](std::size_t c) { return c == 0 || n % 2 == 0 || n < 8; });
    const auto sets = rig.run();
    for (const FrameSet& set : sets) EXPECT_EQ(pictures_in(set), 3);
    EXPECT_GE(rig.link(0).unmatched, 25u);
    EXPECT_EQ(rig.link(0).pictures + rig.link(0).unmatched + rig.link(0).settling, 60u);
}

TEST(FrameSets, ClocksKeptTogetherByPtpNeedNoLearningOfEach) {
    Rig rig({{.delay_ms = 2}, {.delay_ms = 14}, {.delay_ms = 9}});
    rig.clock = CameraClock::kPtp;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> jitter_ms(0, 3);
    for (int n = 0; n < 100; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_GE(sets.size(), 95u);
    EXPECT_NEAR(rig.link(1).skew_max_ms, 0, 0.001)
        << "neither its longer delay nor the jitter is any of its time";
    EXPECT_GT(rig.link(1).lateness_ms, 8);
    EXPECT_EQ(rig.link(1).clock, CameraClock::kPtp);
}

TEST(FrameSets, WithoutTimestampsTheArrivalCounts) {
    Rig rig(std::vector<Rig::Eye>(3));
    rig.clock = CameraClock::kArrival;
    std::mt19937 random(3);
    std::uniform_real_distribution<double> jitter_ms(0, 4);
    for (int n = 0; n < 300; ++n) rig.shoot(n, [&](std::size_t) { return jitter_ms(random); });
    const auto sets = rig.run();
    EXPECT_EQ(sets.size(), 300u);
    for (const FrameSet& set : sets) EXPECT_EQ(pictures_in(set), 3);
}

TEST(FrameSets, AClockThatIsSetAnewIsLearnedAnew) {
    ClockEstimate clock;
    for (int n = 0; n < 100; ++n) clock.add(n * 33'000'000LL, kSteady0 + n * 33'000'000LL + 1'000'000);
    EXPECT_TRUE(clock.settled());
    EXPECT_EQ(clock.add(7, kSteady0 + 100 * 33'000'000LL), kSteady0 + 100 * 33'000'000LL)
        << "the counter began anew";
    EXPECT_FALSE(clock.settled());
}

}  // namespace
}  // namespace kinevox
