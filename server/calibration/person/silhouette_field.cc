#include "server/calibration/person/silhouette_field.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr double kMaxCells = 800;  // about, along the longer side

}  // namespace

SilhouetteField::SilhouetteField(const std::vector<std::uint8_t>& mask, int width, int height)
    : width_(width), height_(height) {
    const int step = std::max(1, static_cast<int>(std::lround(std::max(width, height) / kMaxCells)));
    step_ = static_cast<float>(step);
    const cv::Mat full = as_mat(mask.data(), width, height);
    const cv::Rect box = cv::boundingRect(full);
    if (box.area() == 0) return;
    left = static_cast<float>(box.x), top = static_cast<float>(box.y);
    right = static_cast<float>(box.x + box.width), bottom = static_cast<float>(box.y + box.height);
    cv::Mat inside, outside;
    cv::distanceTransform(full, inside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
    cv::distanceTransform(255 - full, outside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
    columns_ = (width + step - 1) / step, rows_ = (height + step - 1) / step;
    cells_.resize(static_cast<std::size_t>(columns_) * rows_);
    for (int r = 0; r < rows_; ++r)
        for (int c = 0; c < columns_; ++c) {
            const int x = std::min(c * step, width - 1), y = std::min(r * step, height - 1);
            const float in = inside.at<float>(y, x);
            cells_[static_cast<std::size_t>(r) * columns_ + c] =
                in > 0 ? in - 0.5f : 0.5f - outside.at<float>(y, x);
        }
    std::vector<std::vector<cv::Point>> contours;
    cv::findContours(full, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
    for (const auto& contour : contours)
        for (const cv::Point p : contour)
            if (p.x > 1 && p.y > 1 && p.x < width - 2 && p.y < height - 2)  // not along the image border
                edge_.push_back({static_cast<double>(p.x), static_cast<double>(p.y)});
}

float SilhouetteField::distance(float x, float y, float& dx, float& dy) const {
    dx = dy = 0;
    if (!(x >= 0 && y >= 0 && x <= static_cast<float>(width_ - 1) && y <= static_cast<float>(height_ - 1)) ||
        cells_.empty())
        return std::numeric_limits<float>::quiet_NaN();
    const float u = std::min(x / step_, static_cast<float>(columns_ - 1) - 1e-3f);
    const float v = std::min(y / step_, static_cast<float>(rows_ - 1) - 1e-3f);
    const int c = static_cast<int>(u), r = static_cast<int>(v);
    const float a = u - static_cast<float>(c), b = v - static_cast<float>(r);
    const float* const row = &cells_[static_cast<std::size_t>(r) * columns_ + c];
    const float* const next = row + columns_;
    const float upper = row[0] + a * (row[1] - row[0]), lower = next[0] + a * (next[1] - next[0]);
    dx = ((1 - b) * (row[1] - row[0]) + b * (next[1] - next[0])) / step_;
    dy = (lower - upper) / step_;
    return upper + b * (lower - upper);
}

float SilhouetteField::distance(float x, float y) const {
    float dx, dy;
    return distance(x, y, dx, dy);
}

std::vector<Vec2> SilhouetteField::contour(int count) const {
    std::vector<Vec2> out;
    const std::size_t wanted = std::min<std::size_t>(count, edge_.size());
    for (std::size_t i = 0; i < wanted; ++i) out.push_back(edge_[i * edge_.size() / wanted]);
    return out;
}

}  // namespace kinevox
