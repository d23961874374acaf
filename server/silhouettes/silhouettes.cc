#include "server/silhouettes/silhouettes.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr double kNeighbourFraction =
    0.15;                                  // of the largest component's longer side: closer ones belong to it
constexpr double kMinAreaFraction = 0.01;  // of its area
constexpr double kMinImageFraction = 0.0005;  // of the image: less is no person

}  // namespace

std::vector<std::uint8_t> main_subject(std::span<const std::uint8_t> mask, int width, int height) {
    const cv::Mat image = as_mat(mask.data(), width, height);
    cv::Mat labels, boxes, centres;
    const int count = cv::connectedComponentsWithStats(image, labels, boxes, centres, 8, CV_32S);
    const auto area = [&](int i) { return boxes.at<int>(i, cv::CC_STAT_AREA); };
    const auto box = [&](int i) {
        return cv::Rect(boxes.at<int>(i, cv::CC_STAT_LEFT), boxes.at<int>(i, cv::CC_STAT_TOP),
                        boxes.at<int>(i, cv::CC_STAT_WIDTH), boxes.at<int>(i, cv::CC_STAT_HEIGHT));
    };
    int largest = 0;  // 0 is the background
    for (int i = 1; i < count; ++i)
        if (largest == 0 || area(i) > area(largest)) largest = i;
    if (largest == 0 || area(largest) < kMinImageFraction * width * height) return {};

    cv::Rect near = box(largest);
    const int margin = static_cast<int>(kNeighbourFraction * std::max(near.height, near.width));
    near += cv::Point(-margin, -margin);
    near += cv::Size(2 * margin, 2 * margin);
    std::vector<std::uint8_t> value(count, 0);
    for (int i = 1; i < count; ++i)
        if ((box(i) & near).area() > 0 && area(i) > kMinAreaFraction * area(largest)) value[i] = 255;

    std::vector<std::uint8_t> out(mask.size());
    for (int y = 0; y < height; ++y) {
        const int* const from = labels.ptr<int>(y);
        std::uint8_t* const to = out.data() + static_cast<std::size_t>(y) * width;
        for (int x = 0; x < width; ++x) to[x] = value[from[x]];
    }
    return out;
}

SubjectSegmenter::SubjectSegmenter(int width, int height, int channels,
                                   std::span<const kernels::ImageView> background,
                                   const kernels::SegmentationOptions& options)
    : width_(width),
      height_(height),
      segmenter_(kernels::make_segmenter(kernels::Device::kCpu, width, height, channels, options)) {
    segmenter_->learn(background);
}

std::vector<std::uint8_t> SubjectSegmenter::segment(const kernels::ImageView& image) {
    segmenter_->segment(image, {}, silhouettes_);
    return main_subject(silhouettes_.sharp, width_, height_);
}

}  // namespace kinevox
