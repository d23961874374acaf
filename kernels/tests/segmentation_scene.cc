#include "kernels/tests/segmentation_scene.h"

#include <algorithm>
#include <cmath>

namespace kinevox::kernels::testing {

TestRoom::TestRoom(int width, int height, int channels, unsigned seed)
    : width_(width), height_(height), channels_(channels), random_(seed) {
    room_.resize(static_cast<std::size_t>(width) * height * channels);
    const double tint[3] = {0.85, 1.0, 1.1};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            for (int c = 0; c < channels; ++c)
                room_[(static_cast<std::size_t>(y) * width + x) * channels + c] =
                    tint[c] *
                    (110 + 30 * std::sin(x * 0.07) * std::cos(y * 0.05) + ((x / 12 + y / 9) % 2) * 14);
}

std::uint8_t TestRoom::noisy(double level) {
    // Nearly Gaussian and quick: the sum of four uniform bytes, mean 510, sigma 147.8.
    const auto bits = random_();
    const int sum = static_cast<int>((bits & 255) + (bits >> 8 & 255) + (bits >> 16 & 255) + (bits >> 24));
    return static_cast<std::uint8_t>(std::clamp(std::lround(level + noise * (sum - 510) / 147.8), 0l, 255l));
}

TestImage TestRoom::image(double gain) {
    TestImage image{width_, height_, channels_, std::vector<std::uint8_t>(room_.size())};
    for (std::size_t i = 0; i < room_.size(); ++i) image.data[i] = noisy(room_[i] * gain);
    return image;
}

std::vector<TestImage> TestRoom::clip(int images) {
    std::vector<TestImage> clip;
    for (int i = 0; i < images; ++i) clip.push_back(image());
    return clip;
}

void TestRoom::draw(TestImage& image, const Rect& box, int b, int g, int r) {
    const int colour[3] = {b, g, r};
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x)
            for (int c = 0; c < channels_; ++c) image.at(x, y, c) = noisy(colour[c]);
}

void TestRoom::shade(TestImage& image, const Rect& box, double light) {
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x)
            for (int c = 0; c < channels_; ++c)
                image.at(x, y, c) =
                    noisy(room_[(static_cast<std::size_t>(y) * width_ + x) * channels_ + c] * light);
}

std::vector<ImageView> views_of(const std::vector<TestImage>& images) {
    std::vector<ImageView> views;
    for (const TestImage& image : images) views.push_back(image.view());
    return views;
}

double iou_with_box(const std::vector<std::uint8_t>& mask, int width, int height, const Rect& box) {
    int both = 0, either = 0;
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            const bool set = mask[static_cast<std::size_t>(y) * width + x] != 0;
            const bool inside = x >= box.x0 && x < box.x1 && y >= box.y0 && y < box.y1;
            both += set && inside;
            either += set || inside;
        }
    return either ? static_cast<double>(both) / either : 1.0;
}

int count_in(const std::vector<std::uint8_t>& mask, int width, const Rect& box) {
    int count = 0;
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) count += mask[static_cast<std::size_t>(y) * width + x] != 0;
    return count;
}

}  // namespace kinevox::kernels::testing
