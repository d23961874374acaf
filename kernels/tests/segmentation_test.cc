// What a user of the segmenter may rely on, each on a made-up room whose truth is exact.
#include "kernels/segmentation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "kernels/segmentation_memory.h"
#include "kernels/tests/segmentation_scene.h"

#ifdef KINEVOX_HAVE_TBB
#include <oneapi/tbb/global_control.h>
#endif

namespace kinevox::kernels {
namespace {

using testing::count_in;
using testing::iou_with_box;
using testing::TestImage;
using testing::TestRoom;
using testing::views_of;

constexpr int kWidth = 200, kHeight = 150;
constexpr Rect kBody{70, 30, 105, 125};

SegmentationPrior around(const Rect& box, int margin) {
    SegmentationPrior prior;
    prior.region = {box.x0 - margin, box.y0 - margin, box.x1 + margin, box.y1 + margin};
    prior.full_pass = false;
    return prior;
}

std::unique_ptr<Segmenter> learned(TestRoom& room, int channels, SegmentationOptions options = {},
                                   int images = 40) {
    auto segmenter = make_segmenter(Device::kCpu, kWidth, kHeight, channels, options);
    const auto clip = room.clip(images);
    segmenter->learn(views_of(clip));
    return segmenter;
}

TEST(Segmentation, FindsSubjectWithAnyNumberOfSamples) {
    for (int samples : {1, 4, 8, 32, 47, 64}) {
        TestRoom room(kWidth, kHeight, 3);
        SegmentationOptions options;
        options.samples = samples;
        auto segmenter = learned(room, 3, options);
        TestImage image = room.image();
        room.draw(image, kBody, 40, 60, 190);
        Silhouettes out;
        segmenter->segment(image.view(), {}, out);
        EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95) << samples << " samples";
        EXPECT_NEAR(out.centroid_x, (kBody.x0 + kBody.x1 - 1) / 2.0, 0.5);
        EXPECT_NEAR(out.centroid_y, (kBody.y0 + kBody.y1 - 1) / 2.0, 0.5);
        std::int64_t sharp_pixels = 0;
        for (std::size_t i = 0; i < out.sharp.size(); ++i) {
            EXPECT_TRUE(out.sharp[i] == 0 || (out.sharp[i] == 255 && out.loose[i] == 255));
            sharp_pixels += out.sharp[i] != 0;
        }
        EXPECT_EQ(out.sharp_pixels, sharp_pixels);
        EXPECT_EQ(count_in(out.loose, kWidth, {0, 0, kWidth, kHeight}),
                  count_in(out.loose, kWidth, out.bounds));
        EXPECT_GT(out.probability[75 * kWidth + 85], 250);
    }
}

TEST(Segmentation, SupportsGreyImages) {
    TestRoom room(kWidth, kHeight, 1);
    auto segmenter = learned(room, 1);
    TestImage image = room.image();
    room.draw(image, kBody, 240, 0, 0);  // brighter than any light change
    Silhouettes out;
    segmenter->segment(image.view(), {}, out);
    EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95);
}

TEST(Segmentation, ForgetFramesRestoresLearnedModel) {
    TestRoom room(kWidth, kHeight, 3);
    SegmentationOptions options;
    options.update_interval = 2;
    options.absorb_frames = 20;
    auto segmenter = make_rewindable_segmenter(Device::kCpu, kWidth, kHeight, 3, options);
    EXPECT_THROW(segmenter->forget_frames(), std::logic_error);
    const auto clip = room.clip(20);
    segmenter->learn(views_of(clip));
    std::vector<TestImage> images;
    for (int k = 0; k < 60; ++k) {
        images.push_back(room.image(1 + 0.002 * k));
        room.draw(images.back(), kBody, 40, 60, 190);
        room.draw(images.back(), {10, 10, 30, 30}, 120, 130,
                  20);  // stays, and becomes background little by little
    }
    const auto segmented = [&](const TestImage& image) {
        Silhouettes out;
        segmenter->segment(image.view(), {}, out);
        return out.probability;
    };
    const auto first = segmented(images.front());
    for (const TestImage& image : images) segmented(image);
    EXPECT_TRUE(segmented(images.front()) != first) << "frames teach it something";
    segmenter->forget_frames();
    EXPECT_TRUE(segmented(images.front()) == first);
    for (const TestImage& image : images) segmented(image);
    segmenter->forget_frames();
    EXPECT_TRUE(segmented(images.front()) == first);
}

TEST(Segmentation, IgnoresLightFlicker) {
    TestRoom room(kWidth, kHeight, 3);
    auto segmenter = learned(room, 3);
    Silhouettes out;
    for (double gain : {0.9, 0.98, 1.02, 1.1}) {
        TestImage image = room.image(gain);
        segmenter->segment(image.view(), {}, out);
        EXPECT_EQ(out.sharp_pixels, 0) << gain;
        EXPECT_TRUE(out.bounds.empty()) << gain;
        room.draw(image, kBody, 40, 60, 190);
        segmenter->segment(image.view(), {}, out);
        EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95) << gain;
    }
}

TEST(Segmentation, IgnoresShadowButFindsDarkColour) {
    TestRoom room(kWidth, kHeight, 3);
    auto segmenter = learned(room, 3);
    const Rect shadow{110, 60, 170, 120};
    TestImage image = room.image();
    room.shade(image, shadow, 0.6);
    room.draw(image, kBody, 75, 45, 40);  // as dark as the shadow, another chromaticity
    Silhouettes out;
    segmenter->segment(image.view(), {}, out);
    EXPECT_LT(count_in(out.sharp, kWidth, shadow), 0.03 * shadow.width() * shadow.height());
    EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.93);
}

TEST(Segmentation, HandlesEmptyAndFullImages) {
    TestRoom room(kWidth, kHeight, 3);
    auto segmenter = learned(room, 3);
    Silhouettes out;
    segmenter->segment(room.image().view(), {}, out);
    EXPECT_EQ(out.sharp_pixels, 0);
    EXPECT_TRUE(out.bounds.empty());
    EXPECT_EQ(out.searched, (Rect{0, 0, kWidth, kHeight}));
    TestImage covered = room.image();
    room.draw(covered, {0, 0, kWidth, kHeight}, 20, 30, 230);
    segmenter->segment(covered.view(), {}, out);
    EXPECT_GT(out.sharp_pixels, 0.99 * kWidth * kHeight);
}

TEST(Segmentation, LearnsFromSingleImage) {
    TestRoom room(kWidth, kHeight, 3);
    auto segmenter = learned(room, 3, {}, 1);
    TestImage image = room.image();
    Silhouettes out;
    segmenter->segment(image.view(), {}, out);
    EXPECT_EQ(out.sharp_pixels, 0);
    room.draw(image, kBody, 40, 60, 190);
    segmenter->segment(image.view(), {}, out);
    EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95);
}

TEST(Segmentation, RegionPassEqualsFullPassInside) {
    TestRoom room(kWidth, kHeight, 3), twin(kWidth, kHeight, 3);
    auto full = learned(room, 3), confined = learned(twin, 3);
    for (int i = 0; i < 5; ++i) {
        TestImage image = room.image();
        room.draw(image, {kBody.x0 + i, kBody.y0, kBody.x1 + i, kBody.y1}, 40, 60, 190);
        Silhouettes all, part;
        SegmentationPrior prior = around(kBody, 20);
        confined->segment(image.view(), prior, part);
        prior.full_pass = true;
        full->segment(image.view(), prior, all);
        EXPECT_EQ(part.sharp, all.sharp);
        EXPECT_EQ(part.loose, all.loose);
        EXPECT_LT(part.searched.width() * part.searched.height(), kWidth * kHeight);
        EXPECT_EQ(all.searched, (Rect{0, 0, kWidth, kHeight}));
    }
}

TEST(Segmentation, RemovesComponentsOutsideExpectedMask) {
    TestRoom room(kWidth, kHeight, 3);
    auto segmenter = learned(room, 3);
    const Rect stranger{140, 40, 170, 110};
    TestImage image = room.image();
    room.draw(image, kBody, 40, 60, 190);
    room.draw(image, stranger, 190, 60, 40);
    std::vector<std::uint8_t> expected(static_cast<std::size_t>(kWidth) * kHeight, 0);
    for (int y = 50; y < 90; ++y)
        for (int x = 80; x < 95; ++x) expected[y * kWidth + x] = 255;
    SegmentationPrior prior = around(kBody, 60);
    prior.expected = expected.data();
    Silhouettes out;
    segmenter->segment(image.view(), prior, out);
    EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95);
    EXPECT_EQ(count_in(out.loose, kWidth, stranger), 0);
    segmenter->segment(image.view(), {}, out);  // nothing is tracked: both
    EXPECT_GT(count_in(out.sharp, kWidth, stranger), 0.9 * stranger.width() * stranger.height());
}

TEST(Segmentation, DoesNotAbsorbStandingSubject) {
    TestRoom room(kWidth, kHeight, 3);
    SegmentationOptions options;
    options.update_interval = 4;
    options.absorb_frames = 40;
    auto segmenter = learned(room, 3, options);
    Silhouettes out;
    for (int frame = 0; frame < 900; ++frame) {  // 30 s
        TestImage image = room.image();
        room.draw(image, kBody, 40, 60, 190);
        segmenter->segment(image.view(), around(kBody, 20), out);
    }
    EXPECT_GT(iou_with_box(out.sharp, kWidth, kHeight, kBody), 0.95);
}

TEST(Segmentation, AbsorbsMovedObjectAndKeepsOldBackground) {
    TestRoom room(kWidth, kHeight, 3);
    SegmentationOptions options;
    options.update_interval = 4;
    options.absorb_frames = 60;
    auto segmenter = learned(room, 3, options);
    const Rect chair{20, 80, 50, 120};
    Silhouettes out;
    for (int frame = 0; frame < 100; ++frame) {
        TestImage image = room.image();
        room.draw(image, chair, 120, 40, 30);
        segmenter->segment(image.view(), {}, out);
        if (frame == 10) {
            EXPECT_GT(count_in(out.sharp, kWidth, chair), 0.95 * chair.width() * chair.height());
        }
    }
    EXPECT_EQ(count_in(out.sharp, kWidth, chair), 0);
    TestImage taken_away = room.image();
    segmenter->segment(taken_away.view(), {}, out);
    EXPECT_EQ(out.sharp_pixels, 0);
    room.draw(taken_away, chair, 40, 60, 190);  // a person where the chair stood
    segmenter->segment(taken_away.view(), {}, out);
    EXPECT_GT(count_in(out.sharp, kWidth, chair), 0.95 * chair.width() * chair.height());
}

TEST(Segmentation, AdaptsToSlowChanges) {
    TestRoom room(kWidth, kHeight, 3);
    SegmentationOptions options;
    options.update_interval = 2;
    auto segmenter = learned(room, 3, options);
    const Rect wall{100, 0, kWidth, 70};
    Silhouettes out;
    for (int frame = 0; frame < 600; ++frame) {  // the wall's blue fades by 24 levels
        TestImage image = room.image();
        for (int y = wall.y0; y < wall.y1; ++y)
            for (int x = wall.x0; x < wall.x1; ++x)
                image.at(x, y, 0) = static_cast<std::uint8_t>(std::max(0, image.at(x, y, 0) - frame / 25));
        segmenter->segment(image.view(), {}, out);
        ASSERT_LT(out.sharp_pixels, 0.01 * wall.width() * wall.height()) << "frame " << frame;
    }
}

TEST(Segmentation, SameBitsWithAnyThreads) {
    std::vector<Silhouettes> runs;
    for (std::size_t threads : {1u, 4u}) {
#ifdef KINEVOX_HAVE_TBB
        oneapi::tbb::global_control control(oneapi::tbb::global_control::max_allowed_parallelism, threads);
#endif
        TestRoom room(kWidth, kHeight, 3);
        auto segmenter = learned(room, 3);
        Silhouettes out;
        for (int frame = 0; frame < 40; ++frame) {
            TestImage image = room.image();
            room.draw(image, {kBody.x0 + frame / 2, kBody.y0, kBody.x1 + frame / 2, kBody.y1}, 90, 100, 130);
            segmenter->segment(image.view(), {}, out);
        }
        runs.push_back(out);
    }
    EXPECT_EQ(runs[0].sharp, runs[1].sharp);
    EXPECT_EQ(runs[0].loose, runs[1].loose);
    EXPECT_EQ(runs[0].probability, runs[1].probability);
}

TEST(Segmentation, RejectsInvalidInputByName) {
    SegmentationOptions options;
    EXPECT_EQ(options.check(), "");
    options.samples = 0;
    EXPECT_EQ(options.check(), "background_samples is 0; 1 to 255 is allowed");
    EXPECT_THROW(make_segmenter(Device::kCpu, 8, 8, 3, options), std::invalid_argument);
    options = {};
    options.sharp_threshold = std::numeric_limits<float>::quiet_NaN();
    EXPECT_NE(options.check(), "");
    options = {};
    options.loose_threshold = 0.9f;
    EXPECT_NE(options.check(), "");
    EXPECT_THROW(make_segmenter(Device::kCpu, 8, 8, 2, {}), std::invalid_argument);
    auto segmenter = make_segmenter(Device::kCpu, kWidth, kHeight, 3, {});
    EXPECT_FALSE(segmenter->learned());
    TestRoom room(kWidth, kHeight, 3), other(kWidth, kHeight - 1, 3);
    Silhouettes out;
    EXPECT_THROW(segmenter->segment(room.image().view(), {}, out), std::logic_error);
    EXPECT_THROW(segmenter->learn({}), std::invalid_argument);
    const auto wrong = other.clip(1);
    EXPECT_THROW(segmenter->learn(views_of(wrong)), std::invalid_argument);
    const auto right = room.clip(3);
    segmenter->learn(views_of(right));
    EXPECT_TRUE(segmenter->learned());
    EXPECT_THROW(segmenter->segment(other.image().view(), {}, out), std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
