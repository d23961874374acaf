// Shadows judged by several cameras: three of them view a textured floor whose truth is exact.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <span>
#include <stdexcept>
#include <vector>

#include "kernels/cpu/faint_blocks.h"
#include "kernels/floor_grid.h"
#include "kernels/segmentation.h"
#include "kernels/shared/kde_shadow.h"
#include "kernels/stages.h"
#include "kernels/tests/segmentation_scene.h"
#include "kernels/tests/tested_gpu.h"

namespace kinevox::kernels {
namespace {

using testing::count_in;
using testing::TestImage;

constexpr int kImageWidth = 192, kImageHeight = 144;

// 3 m from the world's z axis, looking at it from `azimuth` (radians).
struct Height {
    double of_camera = 2, of_target = 0;  // m
};
CameraModel camera_at(double azimuth, float k1 = 0, Height height = {}) {
    CameraModel c;
    c.width = kImageWidth, c.height = kImageHeight;
    c.fx = c.fy = 200, c.cx = kImageWidth / 2.0f - 0.5f, c.cy = kImageHeight / 2.0f - 0.5f, c.k1 = k1;
    const double down_m = height.of_camera - height.of_target;
    const double distance = std::hypot(3.0, down_m), sine = std::sin(azimuth), cosine = std::cos(azimuth);
    const double forward[3] = {-3 * cosine / distance, -3 * sine / distance, -down_m / distance};
    const double right[3] = {-sine, cosine, 0};
    const double down[3] = {forward[1] * right[2] - forward[2] * right[1],
                            forward[2] * right[0] - forward[0] * right[2],
                            forward[0] * right[1] - forward[1] * right[0]};
    const double centre[3] = {3 * cosine, 3 * sine, height.of_camera};
    const double* rows[3] = {right, down, forward};
    for (int row = 0; row < 3; ++row) {
        double t = 0;
        for (int i = 0; i < 3; ++i) {
            c.rotation_camera_from_world[3 * row + i] = static_cast<float>(rows[row][i]);
            t -= rows[row][i] * centre[i];
        }
        c.translation_camera_from_world[row] = static_cast<float>(t);
    }
    return c;
}

struct FloorPoint {
    float x = 0, y = 0;
    bool seen = false;
};

class FloorCamera {
  public:
    FloorCamera(double azimuth, unsigned seed, float k1 = 0, Height height = {})
        : model(camera_at(azimuth, k1, height)),
          projector_(make_projector(model, "test")),
          directions_(floor_directions(model)),
          random_(seed) {}

    FloorPoint floor_at(int x, int y) const {
        const kde::FloorGrid grid{directions_.xy.data(),
                                  directions_.columns,
                                  {directions_.centre[0], directions_.centre[1], directions_.centre[2]}};
        FloorPoint p;
        p.seen = kde::floor_point(grid, projector_, static_cast<float>(x), static_cast<float>(y), p.x, p.y);
        return p;
    }

    // The floor under a light that depends on the place and on the pixel.
    TestImage image(const std::function<double(FloorPoint, int x, int y)>& light) {
        TestImage image{kImageWidth, kImageHeight, 3,
                        std::vector<std::uint8_t>(kImageWidth * kImageHeight * 3)};
        std::normal_distribution<double> noise(0, 1.5);
        for (int y = 0; y < kImageHeight; ++y)
            for (int x = 0; x < kImageWidth; ++x) {
                const FloorPoint p = floor_at(x, y);
                const double grain = 10 * std::sin(9 * p.x) * std::cos(7 * p.y);
                const double colour[3] = {120 + grain, 135 + grain, 150 + grain};
                for (int c = 0; c < 3; ++c)
                    image.at(x, y, c) = static_cast<std::uint8_t>(
                        std::lround(std::clamp(colour[c] * light(p, x, y) + noise(random_), 0.0, 255.0)));
            }
        return image;
    }

    CameraModel model;

  private:
    Projector projector_;
    FloorDirections directions_;
    std::mt19937 random_;
};

struct Rig {
    std::array<FloorCamera, 3> cameras;
    std::array<std::unique_ptr<Segmenter>, 3> segmenters;

    explicit Rig(Device device, Height height = {}, const SegmentationOptions& options = {})
        : cameras{FloorCamera(0, 1, 0, height), FloorCamera(2.1, 2, 0, height),
                  FloorCamera(4.2, 3, 0, height)} {
        const auto stages = make_stage_factory(device);
        for (int c = 0; c < 3; ++c) {
            segmenters[c] = stages->segmenter(kImageWidth, kImageHeight, 3, options);
            segmenters[c]->set_camera(cameras[c].model);
            std::vector<TestImage> clip;
            for (int n = 0; n < 30; ++n) clip.push_back(cameras[c].image([](auto...) { return 1.0; }));
            segmenters[c]->learn(testing::views_of(clip));
        }
    }

    std::array<Silhouettes, 3> segment(const std::array<TestImage, 3>& images, bool together = false) {
        std::array<Silhouettes, 3> out;
        for (int c = 0; c < 3; ++c) segmenters[c]->begin_frame(images[c].view(), {});
        std::vector<const Segmenter*> all;
        for (const auto& segmenter : segmenters) all.push_back(segmenter.get());
        std::vector<FrameDecision> decisions;
        for (const auto& segmenter : segmenters) decisions.push_back({segmenter.get(), all});
        if (together) segmenters[0]->decide_together(decisions);
        for (int c = 0; c < 3; ++c) segmenters[c]->decide(all, out[c]);
        for (int c = 0; c < 3; ++c) segmenters[c]->end_frame(out[c]);
        return out;
    }
};

constexpr double kDark = 0.7;

void skip_without(Device device) {
    try {
        make_segmenter(device, kImageWidth, kImageHeight, 3);
    } catch (const std::runtime_error& error) {
        if (std::getenv("KINEVOX_REQUIRE_GPU")) FAIL() << "a GPU was asked for, but: " << error.what();
        GTEST_SKIP() << "no GPU: " << error.what();
    }
}

class Shadow : public ::testing::TestWithParam<Device> {
  protected:
    void SetUp() override { skip_without(GetParam()); }
};
class ShadowCuda : public ::testing::Test {
  protected:
    void SetUp() override { skip_without(testing::tested_gpu()); }
};
INSTANTIATE_TEST_SUITE_P(Devices, Shadow, ::testing::Values(Device::kCpu, testing::tested_gpu()),
                         [](const auto& info) { return info.param == Device::kCpu ? "Cpu" : "Cuda"; });

// A round shadow of 0.5 m with a soft edge, in every camera; `shaded`: pixels of its inner part.
std::array<TestImage, 3> with_shadow(Rig& rig, double light, double edge_m, int& shaded) {
    std::array<TestImage, 3> images;
    shaded = 0;
    for (int c = 0; c < 3; ++c)
        images[c] = rig.cameras[c].image([&](FloorPoint p, int, int) {
            const double inside = std::clamp((0.5 - std::hypot(p.x, p.y)) / edge_m, 0.0, 1.0);
            shaded += inside > 0.5;
            return 1 - (1 - light) * inside;
        });
    return images;
}

TEST_P(Shadow, StaysBackgroundWhenAllCamerasSeeTheFloorDark) {
    Rig rig(GetParam());
    int dark = 0;
    const auto images = with_shadow(rig, kDark, 0.1, dark);
    const auto out = rig.segment(images);
    std::int64_t found = 0;
    for (const Silhouettes& s : out) found += s.sharp_pixels;
    EXPECT_GT(dark, 3000);
    EXPECT_LT(static_cast<double>(found), 0.02 * dark);
}

TEST_P(Shadow, IsSubjectWhenAnotherCameraSeesTheFloorLit) {
    Rig rig(GetParam());
    const Rect trousers{80, 40, 110, 100};  // of the floor's chromaticity, in the first camera's image only
    std::array<TestImage, 3> images;
    for (int c = 0; c < 3; ++c)
        images[c] = rig.cameras[c].image([&](FloorPoint, int x, int y) {
            const bool inside = x >= trousers.x0 && x < trousers.x1 && y >= trousers.y0 && y < trousers.y1;
            return c == 0 && inside ? kDark : 1.0;
        });
    const auto out = rig.segment(images);
    const int area = trousers.width() * trousers.height();
    // Even with the floor's own grain, which speaks for a shadow: 0.86 of them.
    EXPECT_GT(count_in(out[0].sharp, kImageWidth, trousers), 0.8 * area);
    EXPECT_LT(static_cast<double>(out[0].sharp_pixels), 1.15 * area);
    EXPECT_EQ(out[1].sharp_pixels, 0);

    // Alone, the first camera takes it for a shadow.
    Silhouettes alone;
    rig.segmenters[0]->segment(images[0].view(), {}, alone);
    EXPECT_LT(count_in(alone.sharp, kImageWidth, trousers), 0.5 * area);
}

TEST_P(Shadow, IsSubjectBeforeAWallWhereTheOtherCamerasSeeIt) {
    // Level cameras: behind the upper half of their images there is no floor.
    Rig rig(GetParam(), {1.2, 1.2});
    const Rect shirt{80, 20, 112, 64}, shadow{8, 20, 40, 64};
    std::array<TestImage, 3> images;
    for (int c = 0; c < 3; ++c) {
        images[c] = rig.cameras[c].image([&](FloorPoint, int x, int y) {
            const auto in = [&](const Rect& r) { return x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1; };
            return c == 0 && (in(shirt) || in(shadow)) ? kDark : 1.0;
        });
        if (c > 0)  // of another colour than what is behind it there
            for (int y = shirt.y0; y < shirt.y1; ++y)
                for (int x = shirt.x0; x < shirt.x1; ++x)
                    for (int channel = 0; channel < 3; ++channel)
                        images[c].at(x, y, channel) = static_cast<std::uint8_t>(channel == 0 ? 200 : 60);
    }
    const auto out = rig.segment(images);
    const int area = shirt.width() * shirt.height();
    EXPECT_GT(count_in(out[0].sharp, kImageWidth, shirt), 0.9 * area);
    EXPECT_LT(count_in(out[0].sharp, kImageWidth, shadow), 0.02 * area);
}

TEST_P(Shadow, DecidesLighterPixelsByTheFloorsTexture) {
    Rig rig(GetParam());
    constexpr double kLight = 1.17;
    std::array<TestImage, 3> images;
    int lighter = 0;
    for (int c = 0; c < 3; ++c)
        images[c] = rig.cameras[c].image([&](FloorPoint p, int, int) {
            // The second camera sees a reflection with a soft edge.
            const double inside = c == 1 ? std::clamp((0.5 - std::hypot(p.x, p.y)) / 0.2, 0.0, 1.0) : 0.0;
            lighter += inside > 0.5;
            return 1 + (kLight - 1) * inside;
        });
    // In the first camera's image, of the floor's mean colour but without its grain.
    const Rect trousers{80, 40, 110, 100};
    std::mt19937 random(4);
    std::normal_distribution<double> weave(0, 6);
    for (int y = trousers.y0; y < trousers.y1; ++y)
        for (int x = trousers.x0; x < trousers.x1; ++x) {
            const double light = kLight * (1 + weave(random) / 135);
            for (int channel = 0; channel < 3; ++channel)
                images[0].at(x, y, channel) =
                    static_cast<std::uint8_t>(std::lround(light * (120 + 15 * channel)));
        }
    const auto out = rig.segment(images);
    EXPECT_GT(lighter, 1000);
    EXPECT_LT(static_cast<double>(out[1].sharp_pixels), 0.02 * lighter);
    const int area = trousers.width() * trousers.height();
    EXPECT_GT(count_in(out[0].sharp, kImageWidth, trousers), 0.9 * area);
}

// Of nearly the floor's brightness and colour in every camera, without its grain.
std::array<TestImage, 3> with_faint_trousers(Rig& rig, const Rect& trousers) {
    std::array<TestImage, 3> images;
    std::mt19937 random(4);
    std::normal_distribution<double> weave(0, 4.5);
    for (int c = 0; c < 3; ++c) {
        images[c] = rig.cameras[c].image([](auto...) { return 1.0; });
        for (int y = trousers.y0; y < trousers.y1; ++y)
            for (int x = trousers.x0; x < trousers.x1; ++x)
                for (int channel = 0; channel < 3; ++channel)
                    images[c].at(x, y, channel) = static_cast<std::uint8_t>(
                        std::lround(1.06 * (120 + 15 * channel) + 3 * (channel - 1) + weave(random)));
    }
    return images;
}

TEST_P(Shadow, FindsClothesOfTheFloorsColourWhenFaintBlocksAreJudged) {
    Rig plain(GetParam()), faint(GetParam(), {}, {.judge_faint = true});
    const Rect trousers{80, 40, 110, 100};
    const int area = trousers.width() * trousers.height();
    const auto images = with_faint_trousers(faint, trousers);
    const auto found = faint.segment(images), missed = plain.segment(images);
    int of_faint = 0, of_plain = 0;
    for (int c = 0; c < 3; ++c) {
        of_faint += count_in(found[c].sharp, kImageWidth, trousers);
        of_plain += count_in(missed[c].sharp, kImageWidth, trousers);
        EXPECT_LT(static_cast<double>(found[c].sharp_pixels), 1.05 * area) << "camera " << c;
    }
    EXPECT_GT(of_faint, 0.6 * 3 * area);
    EXPECT_LT(of_plain, 0.5 * of_faint);
}

TEST_P(Shadow, BeginsAndEndsJudgingFaintBlocksBetweenFrames) {
    SegmentationOptions options{.update_interval = 0, .colour_memory_weight = 0};
    Rig plain(GetParam(), {}, options), switched(GetParam(), {}, options);
    options.judge_faint = true;
    Rig faint(GetParam(), {}, options);
    const auto images = with_faint_trousers(faint, {80, 40, 110, 100});
    const auto expect_equal = [&](Rig& expected) {
        const auto found = switched.segment(images), wanted = expected.segment(images);
        for (int c = 0; c < 3; ++c) EXPECT_EQ(found[c].probability, wanted[c].probability) << "camera " << c;
    };
    const auto judge_faint = [&](bool judge) {
        for (const auto& segmenter : switched.segmenters) segmenter->set_judge_faint(judge);
    };
    expect_equal(plain);
    judge_faint(true);
    expect_equal(faint);
    judge_faint(false);
    expect_equal(plain);
}

TEST_P(Shadow, StaysBackgroundWhenFaintBlocksAreJudged) {
    Rig rig(GetParam(), {}, {.judge_faint = true});
    int shaded = 0;
    const auto images = with_shadow(rig, 0.9, 0.2, shaded);
    const auto out = rig.segment(images);
    std::int64_t found = 0;
    for (const Silhouettes& s : out) found += s.sharp_pixels;
    EXPECT_GT(shaded, 2000);
    EXPECT_LT(static_cast<double>(found), 0.02 * shaded);
}

TEST(FaintBlocks, DifferByMoreThanTheImagesOwnNoise) {
    const kde::BlockDifference usual = kde::usual_difference(0, 0, 3);
    EXPECT_EQ(usual.mean, 1200) << "never below a fifth of a grey level";
    EXPECT_FALSE(kde::is_faint({6 * usual.mean, 0}, usual));
    EXPECT_TRUE(kde::is_faint({6 * usual.mean + 1, 0}, usual));
    const kde::BlockDifference noisy = kde::usual_difference(500, 500, 3);
    EXPECT_GT(noisy.mean, 10 * usual.mean);
    EXPECT_LT(kde::noise_factor(noisy, 3, 0.3f), kde::noise_factor(usual, 3, 0.3f) / 10);
}

TEST(FaintBlocks, SumsOfACellEqualThoseOfItsPixels) {
    std::mt19937 random(9);
    constexpr int kChannels = 3, kCellBytes = kChannels * kde::kCellPixels, kRows = kde::kFaintBlock_px;
    std::vector<std::uint8_t> value(kRows * kCellBytes), reference(kRows * kCellBytes),
        scale(kRows * kCellBytes);
    for (auto* plane : {&value, &reference, &scale})
        for (std::uint8_t& byte : *plane) byte = static_cast<std::uint8_t>(random() & 255);
    kde::BlockDifference blocks[kde::kFaintBlocks];
    cpu::block_differences(value.data(), kCellBytes, reference.data(), scale.data(), kCellBytes, kChannels,
                           blocks);
    for (int block = 0; block < kde::kFaintBlocks; ++block) {
        kde::BlockDifference expected;
        for (int c = 0; c < kChannels; ++c) {
            int sum = 0, squares = 0;
            for (int n = 0; n < kde::kFaintPixels; ++n) {
                const int at = n / kRows * kCellBytes + c * kde::kCellPixels + block * kRows + n % kRows;
                const int difference = kde::scaled_difference(value[at], reference[at], scale[at]);
                sum += difference;
                squares += difference * difference;
            }
            kde::add_channel(expected, sum, squares);
        }
        EXPECT_EQ(blocks[block].mean, expected.mean) << "block " << block;
        EXPECT_EQ(blocks[block].pixel, expected.pixel) << "block " << block;
    }
}

TEST(LimbGate, NeedsALimbsWidthOfChangedPixels) {
    EXPECT_EQ(kde::voted_radius(100), 1);
    EXPECT_EQ(kde::voted_radius(700), 2);  // blocks of the subject
    const int pixels = 3 * 3 * kde::kVoteBlock_px * kde::kVoteBlock_px;
    EXPECT_TRUE(kde::is_limb(pixels / 2, 1));
    EXPECT_FALSE(kde::is_limb(pixels / 3, 1));
}

TEST_F(ShadowCuda, CamerasOfFrameSetNeedOneContext) {
    FloorCamera camera(0, 1, 0, {});
    std::array<std::unique_ptr<Segmenter>, 2> segmenters;
    const TestImage image = camera.image([](auto...) { return 1.0; });
    for (auto& segmenter : segmenters) {
        segmenter = make_segmenter(testing::tested_gpu(), kImageWidth, kImageHeight, 3);
        segmenter->set_camera(camera.model);
        segmenter->learn(std::vector{image.view()});
        segmenter->begin_frame(image.view(), {});
    }
    const Segmenter* const other = segmenters[1].get();
    Silhouettes out;
    EXPECT_THROW(segmenters[0]->decide(std::span(&other, 1), out), std::logic_error);
}

class ShadowForms : public ShadowCuda, public ::testing::WithParamInterface<bool> {};
INSTANTIATE_TEST_SUITE_P(Rules, ShadowForms, ::testing::Bool(),
                         [](const auto& info) { return info.param ? "Faint" : "Plain"; });

TEST_P(ShadowForms, CudaEqualsCpu) {
    const SegmentationOptions options{.judge_faint = GetParam()};
    Rig cpu(Device::kCpu, {1.2, 0.9}, options), gpu(testing::tested_gpu(), {1.2, 0.9}, options);
    const Rect body{80, 20, 112, 110};
    std::array<TestImage, 3> images;
    for (int c = 0; c < 3; ++c)
        images[c] = cpu.cameras[c].image([&](FloorPoint p, int x, int y) {
            const bool inside = x >= body.x0 && x < body.x1 && y >= body.y0 && y < body.y1;
            return inside ? 0.55 + 0.15 * c : p.seen && std::hypot(p.x, p.y - 0.3) < 0.4 ? kDark : 1.0;
        });
    const auto a = cpu.segment(images), b = gpu.segment(images);
    EXPECT_GT(a[0].sharp_pixels, 500);
    for (int c = 0; c < 3; ++c) {
        std::size_t sharp = 0;
        for (std::size_t n = 0; n < a[c].sharp.size(); ++n) sharp += a[c].sharp[n] != b[c].sharp[n];
        EXPECT_LE(sharp, a[c].sharp.size() / 2000) << "camera " << c;
    }
}

TEST_P(Shadow, DecidesCamerasTogetherAsOneByOne) {
    Rig alone(GetParam(), {1.2, 0.9}), together(GetParam(), {1.2, 0.9});
    for (int frame = 0; frame < 3; ++frame) {
        const Rect body{80 + 5 * frame, 20, 112 + 5 * frame, 110};
        std::array<TestImage, 3> images;
        for (int c = 0; c < 3; ++c)
            images[c] = alone.cameras[c].image([&](FloorPoint p, int x, int y) {
                const bool inside = x >= body.x0 && x < body.x1 && y >= body.y0 && y < body.y1;
                return inside ? 0.55 + 0.15 * c : p.seen && std::hypot(p.x, p.y - 0.3) < 0.4 ? kDark : 1.0;
            });
        const auto a = alone.segment(images), b = together.segment(images, true);
        EXPECT_GT(a[0].sharp_pixels, 500);
        for (int c = 0; c < 3; ++c) {
            EXPECT_EQ(a[c].probability, b[c].probability) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].sharp, b[c].sharp) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].loose, b[c].loose) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].centroid_x, b[c].centroid_x) << "camera " << c << ", frame " << frame;
        }
    }
}

TEST(Support, IsTheHighestMeanVoteAlongTheRay) {
    const FloorCamera own(0, 1, 0, {1.2, 1.2}), other(1.6, 2, 0, {1.2, 1.2}), third(2.4, 3, 0, {1.2, 1.2});
    const FloorDirections directions = floor_directions(own.model);
    const kde::FloorGrid grid{directions.xy.data(),
                              directions.columns,
                              {directions.centre[0], directions.centre[1], directions.centre[2]}};
    const Projector camera = make_projector(own.model, "test");
    std::array<kde::SceneView, 2> views;
    constexpr int kColumns = kImageWidth / kde::kVoteBlock_px, kRows = kImageHeight / kde::kVoteBlock_px;
    std::array<std::vector<std::int8_t>, 2> votes;
    const Rect subject{80, 40, 112, 100};
    for (int n = 0; n < 2; ++n) {
        const CameraModel& model = n == 0 ? other.model : third.model;
        votes[n].assign(kColumns * kRows, -kde::kMaxVote);
        for (int y = subject.y0; y < subject.y1; y += kde::kVoteBlock_px)
            for (int x = subject.x0; x < subject.x1; x += kde::kVoteBlock_px)
                votes[n][y / kde::kVoteBlock_px * kColumns + x / kde::kVoteBlock_px] = kde::kMaxVote;
        views[n].camera = make_projector(model, "test");
        views[n].votes = votes[n].data();
        views[n].vote_columns = kColumns;
        views[n].sees = true;
        subject_bounds(subject, model, floor_directions(model), views[n].bounds);
    }
    const auto support = [&](float u, float v) {
        kde::SupportRay ray;
        EXPECT_TRUE(kde::support_ray(grid, camera, u, v, ray));
        return kde::support_of(ray, 2, [&](int n) -> const kde::SceneView& { return views[n]; });
    };
    EXPECT_FLOAT_EQ(support(96, 70), 1);
    EXPECT_FLOAT_EQ(support(20, 70), 0) << "one of two may take the subject for background";
    EXPECT_LT(support(96, 5), kde::kMinSupport);
    std::fill(votes[1].begin(), votes[1].end(), std::int8_t{0});  // doubtful everywhere
    EXPECT_FLOAT_EQ(support(96, 70), 0.5f);
    std::fill(votes[1].begin(), votes[1].end(), std::int8_t{-kde::kMaxVote});
    EXPECT_FLOAT_EQ(support(96, 70), 0);
    std::fill(votes[0].begin(), votes[0].end(), std::int8_t{-kde::kMaxVote});
    EXPECT_LT(support(96, 70), kde::kMinSupport);
    views[0].sees = views[1].sees = false;
    EXPECT_FLOAT_EQ(support(96, 70), kde::kUnknownSupport);
}

TEST(FloorGrid, FloorPointProjectsToItsPixelWithDistortion) {
    for (const float k1 : {0.0f, -0.15f}) {
        const FloorCamera camera(1.0, 5, k1);
        const Projector projector = make_projector(camera.model, "test");
        int seen = 0;
        for (int y = 3; y < kImageHeight; y += 7)
            for (int x = 2; x < kImageWidth; x += 7) {
                const FloorPoint p = camera.floor_at(x, y);
                if (!p.seen) continue;
                ++seen;
                float u, v;
                ASSERT_TRUE(to_pixel(projector, to_camera(projector, p.x, p.y, 0), u, v));
                EXPECT_NEAR(u, x, 0.1);
                EXPECT_NEAR(v, y, 0.1);
            }
        EXPECT_GT(seen, 300) << "k1 " << k1;
    }
}

TEST(ShadowRule, LogarithmIsPreciseEnough) {
    for (float x = 0.01f; x < 200; x *= 1.013f) EXPECT_NEAR(kde::log_of(x), std::log(x), 2e-5) << x;
}

}  // namespace
}  // namespace kinevox::kernels
