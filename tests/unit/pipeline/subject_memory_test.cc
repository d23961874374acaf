// Recognising people who return, by colours and size.
#include "server/pipeline/tracking/subject_memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace kinevox {
namespace {

using kernels::Colour;

struct Look {
    Colour legs, trunk, head;
    double top_m = 1.8, litres = 90;
};

constexpr Look kRed{{30, 40, 90}, {170, 40, 40}, {200, 160, 140}};
constexpr Look kGreen{{90, 80, 60}, {40, 140, 60}, {190, 150, 130}};
constexpr Look kBlack{{25, 25, 28}, {30, 30, 34}, {200, 165, 140}};

// With the noise, folds and light of one frame set: `brightness` is of the place.
Appearance seen(const Look& look, unsigned seed, double brightness = 1) {
    std::mt19937 random(seed);
    std::normal_distribution<double> grain(1, 0.18), noise(0, 3);
    Appearance out;
    out.top_m = look.top_m + 0.01 * noise(random) / 3;
    out.litres = look.litres * (1 + 0.02 * noise(random) / 3);
    const Colour colours[] = {look.legs, look.trunk, look.head};
    for (int band = 0; band < kBodyBands; ++band)
        for (int n = 0; n < 300; ++n) {
            const double light = brightness * grain(random);
            const auto channel = [&](int value) {
                return static_cast<std::uint8_t>(std::clamp(light * value + noise(random), 0.0, 255.0));
            };
            out.colours[band].add(
                {channel(colours[band].r), channel(colours[band].g), channel(colours[band].b)});
        }
    return out;
}

constexpr std::int64_t kSecond_ns = 1'000'000'000;

// Two seconds in the scene.
void visit(SubjectMemory& memory, std::uint32_t id, const Look& look, std::int64_t until_ns,
           Vec3 at = {0, 0, 0.9}) {
    for (unsigned n = 0; n < 10; ++n) memory.observe(id, seen(look, 100 * id + n, 0.85 + 0.03 * n));
    memory.place(id, until_ns, at);
}

TEST(SubjectMemory, RecognisesWhoReturnsInOtherLight) {
    SubjectMemory memory;
    visit(memory, 1, kRed, 2 * kSecond_ns);
    visit(memory, 2, kGreen, 3 * kSecond_ns);
    const auto found = memory.recognise(seen(kRed, 7, 0.7), {2, 1, 0.9}, 9 * kSecond_ns, {}, 0);
    ASSERT_TRUE(found.has_value());
    EXPECT_EQ(found->subject_id, 1u);
    EXPECT_GT(found->probability, SubjectMemory::kMinProbability);
}

TEST(SubjectMemory, RejectsStrangers) {
    SubjectMemory memory;
    visit(memory, 1, kRed, 2 * kSecond_ns);
    const auto found = memory.recognise(seen(kGreen, 7), {2, 1, 0.9}, 9 * kSecond_ns, {}, 0);
    EXPECT_LT(found ? found->probability : 0, SubjectMemory::kMinPossible);
}

TEST(SubjectMemory, RejectsAnotherSizeInTheSameClothes) {
    SubjectMemory memory;
    visit(memory, 1, kBlack, 2 * kSecond_ns);
    Look child = kBlack;
    child.top_m = 1.55, child.litres = 60;
    const auto found = memory.recognise(seen(child, 7), {2, 1, 0.9}, 9 * kSecond_ns, {}, 0);
    EXPECT_LT(found ? found->probability : 0, SubjectMemory::kMinPossible);
}

TEST(SubjectMemory, IsUnsureBetweenTwoInTheSameClothes) {
    SubjectMemory memory;
    visit(memory, 1, kBlack, 2 * kSecond_ns);
    visit(memory, 2, kBlack, 2 * kSecond_ns);
    const auto absent = memory.recognise(seen(kBlack, 7), {2, 1, 0.9}, 9 * kSecond_ns, {}, 0);
    ASSERT_TRUE(absent.has_value());
    EXPECT_LT(absent->probability, SubjectMemory::kMinProbability);
    // One of them is still there, so that a third one may look the same.
    const std::uint32_t present[] = {2};
    const auto beside = memory.recognise(seen(kBlack, 7), {2, 1, 0.9}, 9 * kSecond_ns, present, 0);
    ASSERT_TRUE(beside.has_value());
    EXPECT_EQ(beside->subject_id, 1u);
    EXPECT_LT(beside->probability, SubjectMemory::kMinProbability);
}

TEST(SubjectMemory, NoticesStrayedTracks) {
    SubjectMemory memory;
    visit(memory, 1, kRed, 2 * kSecond_ns);
    EXPECT_TRUE(memory.has_strayed(1, seen(kGreen, 3), seen(kRed, 4)));
    EXPECT_FALSE(memory.has_strayed(1, seen(kRed, 3), seen(kRed, 4))) << "both look like it";
    EXPECT_FALSE(memory.has_strayed(1, seen(kGreen, 3), seen(kBlack, 4))) << "neither does";
    EXPECT_FALSE(memory.has_strayed(2, seen(kGreen, 3), seen(kRed, 4))) << "unknown";
}

TEST(SubjectMemory, ConsidersOnlyWhoCanBeThere) {
    SubjectMemory memory;
    visit(memory, 1, kRed, 2 * kSecond_ns);
    const std::int64_t soon_ns = 2 * kSecond_ns + kSecond_ns / 10;
    EXPECT_FALSE(memory.recognise(seen(kRed, 7), {4, 0, 0.9}, soon_ns, {}, 0)) << "4 m in 0.1 s";
    EXPECT_TRUE(memory.recognise(seen(kRed, 7), {0.5, 0, 0.9}, soon_ns, {}, 0));
    const std::uint32_t present[] = {1};
    EXPECT_FALSE(memory.recognise(seen(kRed, 7), {0, 0, 0.9}, 9 * kSecond_ns, present, 0));
    EXPECT_FALSE(memory.recognise(seen(kRed, 7), {0, 0, 0.9}, 9 * kSecond_ns, {}, 3 * kSecond_ns))
        << "absent for longer than allowed";
    EXPECT_TRUE(memory.knows_absent({}, 0));
    EXPECT_FALSE(memory.knows_absent(present, 0));
    EXPECT_FALSE(memory.knows_absent({}, 3 * kSecond_ns));
    memory.forget();
    EXPECT_FALSE(memory.recognise(seen(kRed, 7), {0, 0, 0.9}, 9 * kSecond_ns, {}, 0));
}

TEST(SubjectMemory, KeepsALimitedNumberOfPeople) {
    SubjectMemory memory;
    for (std::uint32_t id = 1; id <= 80; ++id) visit(memory, id, kRed, id * kSecond_ns);
    const std::vector<RememberedSubject> all = memory.remembered();
    EXPECT_EQ(all.size(), 64u);
    for (const RememberedSubject& each : all) EXPECT_GT(each.subject_id, 16u) << "absent for longest";
}

TEST(Appearance, ComparesOnlyWhatBothShow) {
    const Appearance whole = seen(kRed, 1);
    Appearance legs;
    legs.colours[kLegsBand] = whole.colours[kLegsBand];
    EXPECT_NEAR(colour_distance(whole, whole), 0, 1e-3);
    EXPECT_GT(colour_distance(whole, seen(kGreen, 1)), 0.4);
    EXPECT_TRUE(std::isnan(colour_distance(whole, legs)));
}

}  // namespace
}  // namespace kinevox
