#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "server/calibration/opencv_helpers.h"
#include "server/calibration/wand/wand.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxSpots = 12;
constexpr double kMinLengthPx = 12;  // of the wand in the image
constexpr double kAsBright = 0.8;    // minimum grey level over the brightest spot's for a two-ball wand
constexpr double kAlike = 0.55;      // minimum radius of the farther ball over the nearer one's

struct Spot {
    Vec2 centre;
    double radius_px;
    double grey;  // mean grey level: a lamp or a white ball is brighter than a sleeve
};

std::vector<Spot> bright_spots(const cv::Mat& brighter, const cv::Mat& image,
                               const WandDetectorOptions& options) {
    cv::Mat mask, labels, boxes, centres;
    cv::threshold(brighter, mask, options.min_difference, 255, cv::THRESH_BINARY);
    const int count = cv::connectedComponentsWithStats(mask, labels, boxes, centres, 8, CV_32S);
    std::vector<Spot> spots;
    for (int i = 1; i < count; ++i) {
        const int width = boxes.at<int>(i, cv::CC_STAT_WIDTH), height = boxes.at<int>(i, cv::CC_STAT_HEIGHT);
        const double area = boxes.at<int>(i, cv::CC_STAT_AREA), radius = std::sqrt(area / 3.14159265);
        if (radius < options.min_radius_px || radius > options.max_radius_px) continue;
        if (std::max(width, height) > 2 * std::min(width, height) + 1 || area < 0.55 * width * height)
            continue;  // not round
        // Intensity centroid, including the soft edge.
        const cv::Rect box = cv::Rect(boxes.at<int>(i, cv::CC_STAT_LEFT) - 2,
                                      boxes.at<int>(i, cv::CC_STAT_TOP) - 2, width + 4, height + 4) &
                             cv::Rect(0, 0, mask.cols, mask.rows);
        double sum = 0, x_sum = 0, y_sum = 0;
        for (int y = box.y; y < box.y + box.height; ++y)
            for (int x = box.x; x < box.x + box.width; ++x) {
                if (labels.at<int>(y, x) != i && labels.at<int>(y, x) != 0) continue;
                const double weight = std::max(0, brighter.at<std::uint8_t>(y, x) - 12);
                sum += weight, x_sum += weight * x, y_sum += weight * y;
            }
        if (sum <= 0) continue;
        spots.push_back({{x_sum / sum, y_sum / sum}, radius, cv::mean(image(box), labels(box) == i)[0]});
    }
    std::sort(spots.begin(), spots.end(),
              [](const Spot& a, const Spot& b) { return a.radius_px > b.radius_px; });
    if (spots.size() > kMaxSpots) spots.resize(kMaxSpots);
    return spots;
}

// Two balls of similar size, the only bright ones in the image.
WandDetection two_balls(std::vector<Spot> spots) {
    double brightest = 0;
    for (const Spot& spot : spots) brightest = std::max(brightest, spot.grey);
    std::erase_if(spots, [&](const Spot& spot) { return spot.grey < kAsBright * brightest; });
    if (spots.size() < 2 || spots[1].radius_px < kAlike * spots[0].radius_px) return std::nullopt;
    if (spots.size() > 2 && spots[2].radius_px > kAlike * spots[1].radius_px) return std::nullopt;
    const Vec2 p = spots[0].centre, q = spots[1].centre;
    if (std::hypot(p.x - q.x, p.y - q.y) < kMinLengthPx) return std::nullopt;
    return std::vector<Vec2>{p, q};
}

}  // namespace

WandDetection detect_wand(const Image& image, const Image& empty_scene, const WandSpec& wand,
                          const WandDetectorOptions& options) {
    if (image.empty() || empty_scene.empty()) return std::nullopt;
    cv::Mat brighter;
    const cv::Mat grey = grey_of(image);
    cv::subtract(grey, grey_of(empty_scene), brighter);
    const std::vector<Spot> spots = bright_spots(brighter, grey, options);
    if (wand.middle_m == 0) return two_balls(spots);
    const double expected = wand.middle_m / wand.length_m;
    WandDetection best;
    double least = 1e9;
    int fitting = 0;
    for (std::size_t a = 0; a < spots.size(); ++a)
        for (std::size_t c = 0; c < spots.size(); ++c)
            for (std::size_t b = 0; b < spots.size(); ++b) {
                if (a == b || b == c || a == c) continue;
                const Vec2 p = spots[a].centre, q = spots[b].centre, r = spots[c].centre;
                const double length = std::hypot(r.x - p.x, r.y - p.y);
                if (length < kMinLengthPx) continue;
                const double along =
                    ((q.x - p.x) * (r.x - p.x) + (q.y - p.y) * (r.y - p.y)) / (length * length);
                const double off = std::abs((q.x - p.x) * (r.y - p.y) - (q.y - p.y) * (r.x - p.x)) / length;
                // Perspective changes the ratio a little; the reversed order is far off.
                if (off > 0.02 * length + 1 || std::abs(along - expected) > 0.3 * (1 - 2 * expected))
                    continue;
                ++fitting;
                const double residual = off / length + std::abs(along - expected);
                if (residual < least) least = residual, best = std::vector<Vec2>{p, q, r};
            }
    return fitting == 1 ? best : std::nullopt;  // ambiguous if two fit
}

double changed_fraction(const Image& image, const Image& empty_scene, const WandDetectorOptions& options) {
    if (image.empty() || empty_scene.empty()) return 0;
    cv::Mat difference;
    cv::absdiff(grey_of(image), grey_of(empty_scene), difference);
    return cv::countNonZero(difference > 0.6 * options.min_difference) /
           static_cast<double>(difference.total());
}

int first_permanent_change(const std::vector<double>& changed) {
    constexpr double kMore = 0.02, kMoreTimes = 3;  // than usual in this clip
    const std::size_t count = changed.size(), fewest = std::max<std::size_t>(8, count / 12);
    if (count < 3 * fewest) return -1;
    std::vector<double> sorted = changed;
    std::sort(sorted.begin(), sorted.end());
    const double usual = sorted[count / 10], limit = std::max(usual + kMore, kMoreTimes * usual);
    // Changed nearly always from there on, and nearly never before.
    std::size_t before = 0;
    std::size_t after = std::count_if(changed.begin(), changed.end(), [&](double c) { return c > limit; });
    for (std::size_t i = 0; i + fewest <= count; ++i) {
        if (changed[i] <= limit) continue;
        if (i >= fewest && after >= 0.9 * (count - i) && before <= 0.1 * i) return static_cast<int>(i);
        ++before, --after;
    }
    return -1;
}

}  // namespace kinevox
