#include "server/calibration/procedure/static_scene.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "common/degrees.h"
#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr int kWidths_px[] = {80, 160, 320};  // of the longer side: coarse to fine
constexpr int kRounds = 8;
constexpr double kNoise_grey = 6;             // larger differences are down-weighted
constexpr double kMinVisibleFraction = 0.15;  // of the image
constexpr double kShadowFraction = 0.03;      // of the longer side, around the subject: shadows, motion
constexpr double kStillRotation_deg = 0.1;  // up to which newly visible regions are added to the first image

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

// Grey, smoothed, without NaN. `seen`: 255 where the scene is visible.
struct Level {
    cv::Mat grey, seen;
};

// Grey, as large as the finest level.
cv::Mat reduced(const Image& image) {
    const cv::Mat whole = as_mat(image);
    const double scale =
        static_cast<double>(kWidths_px[std::size(kWidths_px) - 1]) / std::max(image.width, image.height);
    cv::Mat small;
    cv::resize(whole, small, {}, scale, scale, cv::INTER_AREA);
    if (image.channels == 3) cv::cvtColor(small, small, cv::COLOR_BGR2GRAY);
    return small;
}

// `finest`: from reduced(). `ignored`: px of the original image; `longer_px`: of the level.
Level level_of(const cv::Mat& finest, const Image& image, const kernels::Rect& ignored, int longer_px) {
    const double scale = static_cast<double>(longer_px) / std::max(image.width, image.height);
    Level level;
    const double fraction = static_cast<double>(longer_px) / kWidths_px[std::size(kWidths_px) - 1];
    cv::Mat small;
    cv::resize(finest, small, {}, fraction, fraction, cv::INTER_AREA);
    small.convertTo(level.grey, CV_32F);
    cv::GaussianBlur(level.grey, level.grey, {5, 5}, 1.2);
    level.seen = cv::Mat(level.grey.size(), CV_8U, cv::Scalar(255));
    if (!ignored.empty()) {
        const double margin = kShadowFraction * longer_px;
        const cv::Point from(static_cast<int>(scale * ignored.x0 - margin),
                             static_cast<int>(scale * ignored.y0 - margin));
        const cv::Point to(static_cast<int>(scale * ignored.x1 + margin),
                           static_cast<int>(scale * ignored.y1 + margin));
        cv::rectangle(level.seen, from, to, cv::Scalar(0), cv::FILLED);
    }
    return level;
}

struct Motion {
    double x = 0, y = 0, roll = 0;  // px of the level, px, radians about the image centre
    double gain = 1, offset = 0;    // photometric
};

// Sum of robust squared differences, and the step that lowers it.
double compare(const Level& first, const Level& now, const Motion& motion, Matrix5* square, Vector5* right,
               int& used) {
    const cv::Mat& image = now.grey;
    const double cx = 0.5 * (image.cols - 1), cy = 0.5 * (image.rows - 1);
    const double cosine = std::cos(motion.roll), sine = std::sin(motion.roll);
    double cost = 0;
    used = 0;
    if (square) square->setZero(), right->setZero();
    for (int y = 2; y < image.rows - 2; ++y)
        for (int x = 2; x < image.cols - 2; ++x) {
            if (!first.seen.at<std::uint8_t>(y, x)) continue;
            const double u = cosine * (x - cx) - sine * (y - cy) + cx + motion.x;
            const double v = sine * (x - cx) + cosine * (y - cy) + cy + motion.y;
            const int i = static_cast<int>(std::floor(u)), j = static_cast<int>(std::floor(v));
            if (i < 1 || j < 1 || i + 2 >= image.cols || j + 2 >= image.rows ||
                !now.seen.at<std::uint8_t>(j, i))
                continue;
            const double a = u - i, b = v - j;
            const auto at = [&](int row, int column) {
                return static_cast<double>(image.at<float>(row, column));
            };
            const double upper = at(j, i) + a * (at(j, i + 1) - at(j, i));
            const double lower = at(j + 1, i) + a * (at(j + 1, i + 1) - at(j + 1, i));
            const double before = first.grey.at<float>(y, x);
            const double residual = upper + b * (lower - upper) - motion.gain * before - motion.offset;
            const double ratio =
                kNoise_grey * kNoise_grey / (kNoise_grey * kNoise_grey + residual * residual);
            cost += residual * residual * ratio;
            ++used;
            if (!square) continue;
            const double by_u = (1 - b) * (at(j, i + 1) - at(j, i)) + b * (at(j + 1, i + 1) - at(j + 1, i));
            const double by_v = lower - upper;
            Vector5 slope;
            slope << by_u, by_v, by_u * -(v - cy - motion.y) + by_v * (u - cx - motion.x), -before, -1;
            *square += ratio * ratio * slope * slope.transpose();
            *right -= ratio * ratio * residual * slope;
        }
    return used ? cost / used : 0;
}

Motion without_rotation(const Motion& light) {
    return {0, 0, 0, light.gain, light.offset};
}

}  // namespace

struct StaticScene::Levels {
    std::vector<Level> levels;
};

StaticScene::StaticScene(const Camera& camera) : camera_(camera) {}
StaticScene::~StaticScene() = default;
StaticScene::StaticScene(StaticScene&&) noexcept = default;
StaticScene& StaticScene::operator=(StaticScene&&) noexcept = default;

std::optional<SceneShift> StaticScene::measure(const Image& image, const kernels::Rect& ignored) {
    if (image.empty()) return std::nullopt;
    Levels now;
    const cv::Mat finest_image = reduced(image);
    for (const int width : kWidths_px) now.levels.push_back(level_of(finest_image, image, ignored, width));
    if (!first_) {
        first_ = std::make_unique<Levels>(std::move(now));
        return SceneShift{};
    }
    Motion motion;
    double cost = 0;
    int used = 0;
    for (std::size_t l = 0; l < now.levels.size(); ++l) {
        if (l > 0)
            motion.x *= static_cast<double>(kWidths_px[l]) / kWidths_px[l - 1],
                motion.y *= static_cast<double>(kWidths_px[l]) / kWidths_px[l - 1];
        for (int round = 0; round < kRounds; ++round) {
            Matrix5 square;
            Vector5 right;
            cost = compare(first_->levels[l], now.levels[l], motion, &square, &right, used);
            if (used < kMinVisibleFraction * static_cast<double>(now.levels[l].grey.total()))
                return std::nullopt;
            square.diagonal() *= 1 + 1e-4;
            const Vector5 step = square.ldlt().solve(right);
            if (!step.allFinite()) return std::nullopt;
            motion.x += step(0), motion.y += step(1), motion.roll += step(2), motion.gain += step(3),
                motion.offset += step(4);
            if (std::abs(step(0)) + std::abs(step(1)) < 0.005 && std::abs(step(2)) < 1e-5) break;
        }
    }
    const Level& finest = now.levels.back();
    cost = compare(first_->levels.back(), finest, motion, nullptr, nullptr, used);
    int ignored_count = 0;
    const double still =
        compare(first_->levels.back(), finest, without_rotation(motion), nullptr, nullptr, ignored_count);
    const double px =
        static_cast<double>(std::max(camera_.width, camera_.height)) / kWidths_px[std::size(kWidths_px) - 1];
    const double lateral_px = px * std::hypot(motion.x, motion.y);
    SceneShift shift;
    shift.rotation_deg = degrees(std::hypot(std::atan(lateral_px / camera_.fx), motion.roll));
    shift.shift_px = std::hypot(lateral_px, 0.25 * std::max(camera_.width, camera_.height) * motion.roll);
    shift.explained = still > 0 ? std::clamp(1 - cost / still, 0.0, 1.0) : 0;
    if (shift.rotation_deg < kStillRotation_deg)
        for (std::size_t l = 0; l < now.levels.size(); ++l) {
            Level& first = first_->levels[l];
            const cv::Mat fresh = now.levels[l].seen & (255 - first.seen);
            now.levels[l].grey.copyTo(first.grey, fresh);
            first.seen |= fresh;
        }
    return shift;
}

}  // namespace kinevox
