#include "server/calibration/board/board_detector.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "common/median.h"
#include "server/calibration/board/board_drawing.h"
#include "server/calibration/opencv_helpers.h"

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

// Width of the print's edges from dark to light, px: contrast over the steepest slope, across the worse of
// the board's two directions (motion blur), median over the corners. 0 if no corner has neighbours in both
// directions. `points` by id, in the board frame.
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

constexpr std::size_t kMinCorners = 6;

// Twice the signed area of a triangle; positive if a, b, c are clockwise on the screen (y down).
double orientation(cv::Point2f a, cv::Point2f b, cv::Point2f c) {
    return static_cast<double>(b.x - a.x) * (c.y - a.y) - static_cast<double>(b.y - a.y) * (c.x - a.x);
}

float level_at(const cv::Mat& grey, cv::Point2f p) {
    cv::Mat patch;
    cv::getRectSubPix(grey, {3, 3}, p, patch);
    return static_cast<float>(cv::mean(patch)[0]);
}

// Window of the sub-pixel refinement: a fraction of the distance to the nearest neighbour that contains no
// other print.
cv::Size search_window(const std::vector<cv::Point2f>& points, double fraction) {
    double nearest = 1e9;
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t j = 0; j < i; ++j) nearest = std::min(nearest, cv::norm(points[i] - points[j]));
    const int half = std::clamp(static_cast<int>(fraction * nearest), 2, 9);
    return {half, half};
}

void refine(const cv::Mat& grey, std::vector<cv::Point2f>& points, double fraction) {
    cv::cornerSubPix(grey, points, search_window(points, fraction), {-1, -1},
                     {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 40, 0.003});
}

class OpenCvDetector final : public BoardDetector {
  public:
    OpenCvDetector(BoardSpec board, cv::Ptr<cv::aruco::Dictionary> dictionary)
        : board_(std::move(board)), dictionary_(std::move(dictionary)) {
        if (board_.kind == BoardKind::kCharuco)
            charuco_ = cv::aruco::CharucoBoard::create(board_.columns, board_.rows,
                                                       static_cast<float>(board_.square_m),
                                                       static_cast<float>(board_.marker_m), dictionary_);
        parameters_ = cv::aruco::DetectorParameters::create();
        points_ = board_.points();
    }

    const BoardSpec& board() const override { return board_; }

    BoardDetection detect(const Image& image) override {
        if (image.empty()) return {};
        cv::Mat grey = grey_of(image);
        if (board_.inverted) grey = 255 - grey;
        BoardDetection detection = detect_in(grey);
        if (!detection.found() && board_.kind != BoardKind::kCheckerboard) {
            cv::Mat mirror;
            cv::flip(grey, mirror, 1);
            detection.mirrored_image = detect_in(mirror).corners.size() >= 2 * kMinCorners;
            detection.corners.clear();
        }
        if (detection.found()) detection.edge_px = edge_width_px(grey, detection.corners, points_);
        return detection;
    }

    Image draw(double pixels_per_m, Vec2& origin_px) const override {
        return draw_board(board_, dictionary_, pixels_per_m, origin_px);
    }

  private:
    BoardDetection detect_in(const cv::Mat& grey) {
        BoardDetection detection;
        switch (board_.kind) {
            case BoardKind::kCheckerboard:
                detection.corners = checkerboard(grey);
                break;
            case BoardKind::kCharuco:
                detection.corners = charuco(grey);
                break;
            case BoardKind::kAprilGrid:
                detection.corners = april_grid(grey);
                break;
        }
        if (detection.corners.size() < kMinCorners || on_one_line(detection.corners))
            detection.corners.clear();
        return detection;
    }

    // Collinear corners do not determine a pose.
    bool on_one_line(const std::vector<Corner>& corners) const {
        double max_area = 0;
        const Vec3 a = points_[corners.front().id];
        for (const Corner& b : corners)
            for (const Corner& c : corners)
                max_area = std::max(max_area, norm(cross(points_[b.id] - a, points_[c.id] - a)));
        return max_area < 0.5 * board_.square_m * board_.square_m;
    }

    std::vector<Corner> checkerboard(const cv::Mat& grey) const {
        const cv::Size size(board_.columns, board_.rows);
        std::vector<cv::Point2f> found;
        if (!cv::findChessboardCornersSB(grey, size, found,
                                         cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_ACCURACY)) {
            if (!cv::findChessboardCorners(
                    grey, size, found,
                    cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE | cv::CALIB_CB_FAST_CHECK))
                return {};
            refine(grey, found, 1.0 / 3);
        }
        const int columns = board_.columns, rows = board_.rows;
        const auto at = [&](int column, int row) { return found[row * columns + column]; };
        // Ids run right and up, counter-clockwise on the screen; OpenCV may have counted rows
        // downwards.
        if (orientation(at(0, 0), at(columns - 1, 0), at(0, rows - 1)) > 0)
            for (int row = 0; row < rows / 2; ++row)
                std::swap_ranges(found.begin() + row * columns, found.begin() + (row + 1) * columns,
                                 found.begin() + (rows - 1 - row) * columns);
        // Of the two orientations, the one whose lower left square (between the first four corners) is dark.
        if (board_.has_direction()) {
            const auto square = [&](int column, int row) {
                return level_at(grey, 0.25f * (at(column, row) + at(column + 1, row) + at(column, row + 1) +
                                               at(column + 1, row + 1)));
            };
            if (square(0, 0) > square(columns - 2, rows - 2)) std::reverse(found.begin(), found.end());
        }
        std::vector<Corner> corners;
        for (std::size_t i = 0; i < found.size(); ++i)
            corners.push_back({static_cast<int>(i), {found[i].x, found[i].y}});
        return corners;
    }

    std::vector<Corner> charuco(const cv::Mat& grey) const {
        std::vector<int> markers, ids;
        std::vector<std::vector<cv::Point2f>> contours, rejections;
        cv::aruco::detectMarkers(grey, dictionary_, contours, markers, parameters_, rejections);
        if (markers.empty()) return {};
        cv::aruco::refineDetectedMarkers(grey, charuco_.staticCast<cv::aruco::Board>(), contours, markers,
                                         rejections);
        std::vector<cv::Point2f> found;
        cv::aruco::interpolateCornersCharuco(contours, markers, grey, charuco_, found, ids);
        // OpenCV's own refinement extends to the markers' corners, which bias it.
        if (found.size() >= kMinCorners) refine(grey, found, 0.5 * (1 - board_.marker_m / board_.square_m));
        // OpenCV 4.6 counts rows from the top of the print, ours from below.
        const int columns = board_.columns - 1, rows = board_.rows - 1;
        std::vector<Corner> corners;
        for (std::size_t i = 0; i < ids.size(); ++i)
            if (ids[i] >= 0 && ids[i] < static_cast<int>(points_.size()))
                corners.push_back(
                    {(rows - 1 - ids[i] / columns) * columns + ids[i] % columns, {found[i].x, found[i].y}});
        std::sort(corners.begin(), corners.end(),
                  [](const Corner& a, const Corner& b) { return a.id < b.id; });
        return corners;
    }

    // Generators differ in the width of the tags' border and in their first corner; the right choice puts the
    // corners of all tags on one plane.
    std::vector<Corner> april_grid(const cv::Mat& grey) {
        std::vector<Corner> best;
        for (const int border : {april_border_, 3 - april_border_}) {
            parameters_->markerBorderBits = border;
            std::vector<int> tags;
            std::vector<std::vector<cv::Point2f>> contours;
            cv::aruco::detectMarkers(grey, dictionary_, contours, tags, parameters_);
            std::vector<cv::Point2f> pixels;
            std::vector<int> known;
            for (std::size_t t = 0; t < tags.size(); ++t)
                if (tags[t] < board_.columns * board_.rows) {
                    known.push_back(tags[t]);
                    pixels.insert(pixels.end(), contours[t].begin(), contours[t].end());
                }
            if (known.size() < 2) continue;
            april_border_ = border;
            refine(grey, pixels, 1.0 / 3);
            double least = 1e9;
            for (int first = 0; first < 4; ++first) {
                std::vector<Corner> corners;
                std::vector<cv::Point2f> on_board;
                for (std::size_t i = 0; i < pixels.size(); ++i) {
                    const int id = 4 * known[i / 4] + (static_cast<int>(i) + first) % 4;
                    corners.push_back({id, {pixels[i].x, pixels[i].y}});
                    on_board.emplace_back(static_cast<float>(points_[id].x),
                                          static_cast<float>(points_[id].y));
                }
                const double error = plane_error(on_board, pixels);
                if (error < least) least = error, best = std::move(corners);
            }
            break;
        }
        std::sort(best.begin(), best.end(), [](const Corner& a, const Corner& b) { return a.id < b.id; });
        return best;
    }

    static double plane_error(const std::vector<cv::Point2f>& on_board,
                              const std::vector<cv::Point2f>& pixels) {
        const cv::Mat h = cv::findHomography(on_board, pixels);
        if (h.empty()) return 1e8;
        std::vector<cv::Point2f> back;
        cv::perspectiveTransform(on_board, back, h);
        double sum = 0;
        for (std::size_t i = 0; i < back.size(); ++i) sum += cv::norm(back[i] - pixels[i]);
        return sum;
    }

    BoardSpec board_;
    cv::Ptr<cv::aruco::Dictionary> dictionary_;
    cv::Ptr<cv::aruco::CharucoBoard> charuco_;
    cv::Ptr<cv::aruco::DetectorParameters> parameters_;
    std::vector<Vec3> points_;
    int april_border_ = 2;  // Kalibr prints two bits
};

constexpr std::pair<const char*, cv::aruco::PREDEFINED_DICTIONARY_NAME> kDictionaries[] = {
    {"DICT_4X4_50", cv::aruco::DICT_4X4_50},
    {"DICT_4X4_100", cv::aruco::DICT_4X4_100},
    {"DICT_4X4_250", cv::aruco::DICT_4X4_250},
    {"DICT_4X4_1000", cv::aruco::DICT_4X4_1000},
    {"DICT_5X5_50", cv::aruco::DICT_5X5_50},
    {"DICT_5X5_100", cv::aruco::DICT_5X5_100},
    {"DICT_5X5_250", cv::aruco::DICT_5X5_250},
    {"DICT_5X5_1000", cv::aruco::DICT_5X5_1000},
    {"DICT_6X6_50", cv::aruco::DICT_6X6_50},
    {"DICT_6X6_100", cv::aruco::DICT_6X6_100},
    {"DICT_6X6_250", cv::aruco::DICT_6X6_250},
    {"DICT_6X6_1000", cv::aruco::DICT_6X6_1000},
    {"DICT_7X7_50", cv::aruco::DICT_7X7_50},
    {"DICT_7X7_100", cv::aruco::DICT_7X7_100},
    {"DICT_7X7_250", cv::aruco::DICT_7X7_250},
    {"DICT_7X7_1000", cv::aruco::DICT_7X7_1000},
    {"DICT_ARUCO_ORIGINAL", cv::aruco::DICT_ARUCO_ORIGINAL},
    {"DICT_APRILTAG_16h5", cv::aruco::DICT_APRILTAG_16h5},
    {"DICT_APRILTAG_25h9", cv::aruco::DICT_APRILTAG_25h9},
    {"DICT_APRILTAG_36h10", cv::aruco::DICT_APRILTAG_36h10},
    {"DICT_APRILTAG_36h11", cv::aruco::DICT_APRILTAG_36h11},
};

}  // namespace

absl::StatusOr<std::unique_ptr<BoardDetector>> BoardDetector::create(const BoardSpec& board) {
    if (const std::string problem = board.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    if (board.kind == BoardKind::kCheckerboard) return std::make_unique<OpenCvDetector>(board, nullptr);
    std::string names;
    for (const auto& [name, id] : kDictionaries) {
        names += names.empty() ? name : std::string(", ") + name;
        if (board.dictionary != name) continue;
        const cv::Ptr<cv::aruco::Dictionary> dictionary = cv::aruco::getPredefinedDictionary(id);
        const int needed =
            board.kind == BoardKind::kAprilGrid ? board.columns * board.rows : board.columns * board.rows / 2;
        if (needed > dictionary->bytesList.rows)
            return absl::InvalidArgumentError(
                fmt::format("a board of {} x {} needs {} markers, {} has {}; use a larger dictionary",
                            board.columns, board.rows, needed, name, dictionary->bytesList.rows));
        return std::make_unique<OpenCvDetector>(board, dictionary);
    }
    return absl::InvalidArgumentError(
        fmt::format("unknown dictionary '{}'; use one of {}", board.dictionary.substr(0, 60), names));
}

}  // namespace kinevox
