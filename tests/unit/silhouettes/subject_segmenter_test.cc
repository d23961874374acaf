// One camera's subject, segmented without tracking.
#include <gtest/gtest.h>

#include <algorithm>

#include "server/silhouettes/silhouettes.h"

namespace kinevox {
namespace {

constexpr int kWidth = 64, kHeight = 48;

// A grey image with a bright rectangle.
std::vector<std::uint8_t> image_with(int x0, int y0, int x1, int y1) {
    std::vector<std::uint8_t> image(std::size_t{3} * kWidth * kHeight, 90);
    for (int y = y0; y < y1; ++y)
        std::fill_n(image.begin() + 3 * (y * kWidth + x0), 3 * (x1 - x0), std::uint8_t{220});
    return image;
}

kernels::ImageView view_of(const std::vector<std::uint8_t>& image) {
    return {image.data(), kWidth, kHeight, 3, std::ptrdiff_t{3} * kWidth};
}

TEST(SubjectSegmenter, FindsThePersonAgainstTheBackground) {
    const auto background = image_with(0, 0, 0, 0), person = image_with(20, 8, 36, 44);
    const std::vector<kernels::ImageView> views(5, view_of(background));
    SubjectSegmenter segmenter(kWidth, kHeight, 3, views, {});
    EXPECT_TRUE(segmenter.segment(view_of(background)).empty());
    const auto mask = segmenter.segment(view_of(person));
    ASSERT_EQ(mask.size(), std::size_t{kWidth} * kHeight);
    EXPECT_EQ(mask[26 * kWidth + 28], 255);
    EXPECT_EQ(mask[26 * kWidth + 4], 0);
}

TEST(MainSubject, KeepsTheLargestComponentAndItsNeighbours) {
    std::vector<std::uint8_t> mask(std::size_t{kWidth} * kHeight, 0);
    const auto fill = [&](int x0, int y0, int x1, int y1) {
        for (int y = y0; y < y1; ++y) std::fill_n(mask.begin() + y * kWidth + x0, x1 - x0, std::uint8_t{1});
    };
    fill(10, 6, 22, 40);   // body
    fill(24, 12, 28, 16);  // hand, 2 px away
    fill(56, 2, 60, 6);    // something else
    const auto subject = main_subject(mask, kWidth, kHeight);
    EXPECT_EQ(subject[20 * kWidth + 15], 255);
    EXPECT_EQ(subject[14 * kWidth + 26], 255);
    EXPECT_EQ(subject[4 * kWidth + 58], 0);
    EXPECT_TRUE(main_subject(std::vector<std::uint8_t>(mask.size(), 0), kWidth, kHeight).empty());
}

}  // namespace
}  // namespace kinevox
