#include "server/calibration/board/sharpness.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "common/median.h"

namespace kinevox {
namespace {

// The other corner nearest to `corner` along the board's x (axis 0) or y (axis 1); null if there is none.
const Corner* neighbour(const Corner& corner, const std::vector<Corner>& corners,
                        const std::vector<Vec3>& points, int axis) {
    const Corner* nearest = nullptr;
    double least = 1e9;
    for (const Corner& other : corners) {
        if (other.id == corner.id) continue;
        const Vec3 d = points[other.id] - points[corner.id];
        const double along = std::abs(axis == 0 ? d.x : d.y), across = std::abs(axis == 0 ? d.y : d.x);
        if (across < 0.05 * along && along < least) least = along, nearest = &other;
    }
    return nearest;
}

}  // namespace

double edge_width_px(const cv::Mat& grey, const std::vector<Corner>& corners,
                     const std::vector<Vec3>& points) {
    std::vector<double> widths;
    for (const Corner& corner : corners) {
        const Corner* along[2] = {neighbour(corner, corners, points, 0),
                                  neighbour(corner, corners, points, 1)};
        if (!along[0] || !along[1]) continue;
        double spacing = 1e9;
        cv::Vec2d normal[2];
        for (int axis = 0; axis < 2; ++axis) {
            const double dx = along[axis]->pixel.x - corner.pixel.x,
                         dy = along[axis]->pixel.y - corner.pixel.y;
            const double length = std::hypot(dx, dy);
            spacing = std::min(spacing, length);
            normal[axis] = {-dy / length, dx / length};
        }
        const int half = std::clamp(static_cast<int>(0.4 * spacing), 3, 24);
        const cv::Rect box(static_cast<int>(std::lround(corner.pixel.x)) - half,
                           static_cast<int>(std::lround(corner.pixel.y)) - half, 2 * half + 1, 2 * half + 1);
        if ((box & cv::Rect(0, 0, grey.cols, grey.rows)) != box) continue;
        cv::Mat patch, dx, dy;
        grey(box).convertTo(patch, CV_32F);
        cv::Sobel(patch, dx, CV_32F, 1, 0, 3, 1.0 / 8);
        cv::Sobel(patch, dy, CV_32F, 0, 1, 3, 1.0 / 8);
        double darkest = 0, lightest = 0;
        cv::minMaxLoc(patch, &darkest, &lightest);
        double flattest = 1e9;
        for (const cv::Vec2d& n : normal) {
            double steepest = 0;
            for (int y = 1; y < patch.rows - 1; ++y)
                for (int x = 1; x < patch.cols - 1; ++x)
                    steepest =
                        std::max(steepest, std::abs(n[0] * dx.at<float>(y, x) + n[1] * dy.at<float>(y, x)));
            flattest = std::min(flattest, steepest);
        }
        if (flattest > 0) widths.push_back((lightest - darkest) / flattest);
    }
    if (widths.empty()) return 0;
    return median_of(widths);
}

}  // namespace kinevox
