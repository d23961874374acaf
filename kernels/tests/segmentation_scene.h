// A made-up room for the segmentation's tests: textured background, sensor noise, and whatever is drawn on
// it.
#pragma once

#include <cstdint>
#include <random>
#include <vector>

#include "kernels/segmentation.h"

namespace kinevox::kernels::testing {

struct TestImage {
    int width = 0, height = 0, channels = 0;
    std::vector<std::uint8_t> data;
    ImageView view() const {
        return {data.data(), width, height, channels, static_cast<std::ptrdiff_t>(width) * channels};
    }
    std::uint8_t& at(int x, int y, int c) {
        return data[(static_cast<std::size_t>(y) * width + x) * channels + c];
    }
};

class TestRoom {
  public:
    TestRoom(int width, int height, int channels, unsigned seed = 7);

    // The room under `gain` times its light, with noise of `noise` grey levels.
    TestImage image(double gain = 1.0);
    std::vector<TestImage> clip(int images);

    // B, G, R (grey: the first) without noise's correlation; truth is exact.
    void draw(TestImage& image, const Rect& box, int b, int g, int r);
    // Multiplies the light inside the box.
    void shade(TestImage& image, const Rect& box, double light);

    double noise = 1.5;

  private:
    std::uint8_t noisy(double level);

    int width_, height_, channels_;
    std::vector<double> room_;
    std::mt19937 random_;
};

std::vector<ImageView> views_of(const std::vector<TestImage>& images);

// Intersection over union of a mask and a box.
double iou_with_box(const std::vector<std::uint8_t>& mask, int width, int height, const Rect& box);

// Set pixels of a mask inside a box.
int count_in(const std::vector<std::uint8_t>& mask, int width, const Rect& box);

}  // namespace kinevox::kernels::testing
