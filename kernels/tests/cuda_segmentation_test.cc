// The CUDA segmentation against the CPU's, frame for frame on a noisy image that a square walks through.
#include <gtest/gtest.h>

#include <cstdlib>
#include <memory>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/segmentation.h"
#include "kernels/stages.h"
#include "kernels/tests/tested_gpu.h"

namespace kinevox::kernels {
namespace {

struct Image {
    int width, height, channels;
    std::vector<std::uint8_t> data;
    ImageView view() const {
        return {data.data(), width, height, channels, static_cast<std::ptrdiff_t>(width) * channels};
    }
};

// `square_x` < 0: the empty scene.
Image draw(int width, int height, int channels, int square_x, std::mt19937& random) {
    Image out{width, height, channels,
              std::vector<std::uint8_t>(static_cast<std::size_t>(width) * height * channels)};
    std::normal_distribution<float> noise(0, 2);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c) {
                float value = 90.f + 40.f * ((x / 16 + y / 16) % 2) + 10.f * c;
                if (square_x >= 0)
                    value *= y > height / 2 && x < square_x + 60 && x > square_x - 20 ? 0.8f : 1.f;  // shadow
                if (square_x >= 0 && x >= square_x && x < square_x + 30 && y >= 20 && y < 70)
                    value = c == 0 ? 200.f : 60.f;
                value += noise(random);
                out.data[(static_cast<std::size_t>(y) * width + x) * channels + c] =
                    static_cast<std::uint8_t>(std::min(255.f, std::max(0.f, value)));
            }
    return out;
}

class CudaSegmentation : public ::testing::Test {
  protected:
    void SetUp() override {
        try {
            make_segmenter(testing::tested_gpu(), 64, 48, 3);
        } catch (const std::runtime_error& error) {
            if (std::getenv("KINEVOX_REQUIRE_GPU")) FAIL() << "a GPU was asked for, but: " << error.what();
            GTEST_SKIP() << "not compared with the CPU: " << error.what();
        }
    }
};

TEST_F(CudaSegmentation, EqualsCpuFormForEachFrame) {
    for (int channels : {3, 1}) {
        std::mt19937 random(11);
        const int width = 200, height = 96;  // the last cell is not whole
        SegmentationOptions options;
        options.update_interval = 2;
        auto cpu = make_segmenter(Device::kCpu, width, height, channels, options);
        auto gpu = make_segmenter(testing::tested_gpu(), width, height, channels, options);
        std::vector<Image> empty;
        std::vector<ImageView> views;
        for (int n = 0; n < 10; ++n) empty.push_back(draw(width, height, channels, -1, random));
        for (const Image& image : empty) views.push_back(image.view());
        cpu->learn(views);
        gpu->learn(views);
        Silhouettes a, b;
        std::vector<std::uint8_t> expected(static_cast<std::size_t>(width) * height, 0);
        for (int frame = 0; frame < 6; ++frame) {
            const Image image = draw(width, height, channels, frame == 4 ? -1 : 30 + 20 * frame, random);
            SegmentationPrior prior;
            if (frame >= 2) {
                prior.region = {20, 5, 190, 90};
                prior.full_pass = frame % 2 == 0;
                std::fill(expected.begin() + 40 * width, expected.begin() + 60 * width, std::uint8_t{255});
                prior.expected = expected.data();
            }
            cpu->segment(image.view(), prior, a);
            gpu->segment(image.view(), prior, b);
            EXPECT_EQ(a.searched, b.searched);
            std::size_t levels = 0, sharp = 0, loose = 0;
            for (std::size_t n = 0; n < a.sharp.size(); ++n) {
                levels += std::abs(a.probability[n] - b.probability[n]) > 2;
                sharp += a.sharp[n] != b.sharp[n];
                loose += a.loose[n] != b.loose[n];
            }
            const std::size_t few = a.sharp.size() / 2000;
            EXPECT_LE(levels, few) << "frame " << frame;
            EXPECT_LE(sharp, few) << "frame " << frame;
            EXPECT_LE(loose, few) << "frame " << frame;
            EXPECT_NEAR(static_cast<double>(a.sharp_pixels), static_cast<double>(b.sharp_pixels),
                        static_cast<double>(few));
            if (frame != 4) {
                EXPECT_GT(b.sharp_pixels, 1000) << "frame " << frame;
                EXPECT_NEAR(a.centroid_x, b.centroid_x, 0.1);
                EXPECT_NEAR(a.centroid_y, b.centroid_y, 0.1);
            }
        }
        EXPECT_THROW(gpu->segment(draw(64, 48, channels, -1, random).view(), {}, b), std::invalid_argument);
    }
}

// Images of different sizes, a camera without an image, and regions that come and go.
TEST_F(CudaSegmentation, DecidesFrameSetAsCamerasAlone) {
    constexpr int kCameras = 3, kSizes[kCameras][2] = {{200, 96}, {130, 150}, {64, 75}};
    std::mt19937 random(5);
    std::vector<std::unique_ptr<Segmenter>> alone, together;
    const auto stages = make_stage_factory(testing::tested_gpu());
    for (const auto& size : kSizes) {
        std::vector<Image> empty;
        std::vector<ImageView> views;
        for (int n = 0; n < 6; ++n) empty.push_back(draw(size[0], size[1], 3, -1, random));
        for (const Image& image : empty) views.push_back(image.view());
        SegmentationOptions options;
        options.update_interval = static_cast<int>(alone.size());  // 0: never
        for (auto* segmenters : {&alone, &together}) {
            segmenters->push_back(stages->segmenter(size[0], size[1], 3, options));
            segmenters->back()->learn(views);
        }
    }
    std::vector<Silhouettes> a(kCameras), b(kCameras);
    for (int frame = 0; frame < 6; ++frame) {
        std::vector<FrameDecision> decisions;
        std::vector<Image> images;
        std::vector<int> seeing;
        for (int c = 0; c < kCameras; ++c) {
            images.push_back(draw(kSizes[c][0], kSizes[c][1], 3, frame == 4 ? -1 : 10 + 4 * frame, random));
            if (frame == 2 && c == 0) continue;
            seeing.push_back(c);
            decisions.push_back({together[c].get(), {}});
        }
        for (const int c : seeing) {
            SegmentationPrior prior;
            if (frame % 2 == 1) prior.region = {5 + 20 * c, 10, 60 + 40 * c, 70}, prior.full_pass = false;
            alone[c]->segment(images[c].view(), prior, a[c]);
            together[c]->begin_frame(images[c].view(), prior);
        }
        together[seeing.front()]->decide_together(decisions);
        for (const int c : seeing) together[c]->decide({}, b[c]);
        for (const int c : seeing) together[c]->end_frame(b[c]);
        for (const int c : seeing) {
            EXPECT_EQ(a[c].probability, b[c].probability) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].sharp, b[c].sharp) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].loose, b[c].loose) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].bounds, b[c].bounds) << "camera " << c << ", frame " << frame;
            EXPECT_EQ(a[c].sharp_pixels, b[c].sharp_pixels) << "camera " << c << ", frame " << frame;
        }
    }
    EXPECT_GT(b[0].sharp_pixels, 1000);
}

}  // namespace
}  // namespace kinevox::kernels
