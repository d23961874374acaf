#include "server/calibration/board/board_drawing.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace kinevox {
namespace {

// A canvas addressed in the board frame (y up).
struct Canvas {
    cv::Mat image;
    double pixels_per_m;
    Vec2 origin_px;

    cv::Rect rect(double x0_m, double y0_m, double side_m) const {
        const int left = static_cast<int>(std::lround(origin_px.x + x0_m * pixels_per_m));
        const int top = static_cast<int>(std::lround(origin_px.y - (y0_m + side_m) * pixels_per_m));
        const int side = static_cast<int>(std::lround(side_m * pixels_per_m));
        return {left, top, side, side};
    }
    void paint(double x0_m, double y0_m, double side_m, std::uint8_t grey) {
        image(rect(x0_m, y0_m, side_m)) = grey;
    }
    void marker(const cv::Ptr<cv::aruco::Dictionary>& dictionary, int id, double x0_m, double y0_m,
                double side_m, int border) {
        const cv::Rect box = rect(x0_m, y0_m, side_m);
        cv::Mat marker;
        cv::aruco::drawMarker(dictionary, id, box.width, marker, border);
        marker.copyTo(image(box));
    }
};

void draw_squares(const BoardSpec& board, const cv::Ptr<cv::aruco::Dictionary>& dictionary, Canvas& canvas) {
    const bool charuco = board.kind == BoardKind::kCharuco;
    const int columns = board.columns + (charuco ? 0 : 1), rows = board.rows + (charuco ? 0 : 1);
    int marker = 0;
    for (int from_top = 0; from_top < rows; ++from_top)  // OpenCV counts markers from the upper left
        for (int column = 0; column < columns; ++column) {
            const int row = rows - 1 - from_top;
            const double x = column * board.square_m, y = row * board.square_m;
            const bool dark = charuco ? column % 2 == from_top % 2 : column % 2 == row % 2;
            if (dark) {
                canvas.paint(x, y, board.square_m, 0);
            } else if (charuco) {
                const double margin = (board.square_m - board.marker_m) / 2;
                canvas.marker(dictionary, marker++, x + margin, y + margin, board.marker_m, 1);
            }
        }
}

void draw_tags(const BoardSpec& board, const cv::Ptr<cv::aruco::Dictionary>& dictionary, Canvas& canvas) {
    const double step = board.square_m + board.marker_m;
    for (int row = 0; row <= board.rows; ++row)
        for (int column = 0; column <= board.columns; ++column) {
            const double x = column * step, y = row * step;
            canvas.paint(x - board.marker_m, y - board.marker_m, board.marker_m, 0);
            if (row < board.rows && column < board.columns)
                canvas.marker(dictionary, row * board.columns + column, x, y, board.square_m, 2);
        }
}

}  // namespace

Image draw_board(const BoardSpec& board, const cv::Ptr<cv::aruco::Dictionary>& dictionary,
                 double pixels_per_m, Vec2& origin_px) {
    const bool april = board.kind == BoardKind::kAprilGrid;
    const int more = board.kind == BoardKind::kCheckerboard ? 1 : 0;
    const double step = april ? board.square_m + board.marker_m : board.square_m;
    const double margin = april ? 2 * std::max(board.marker_m, 0.1 * board.square_m) : board.square_m;
    const double width_m = (board.columns + more) * step + 2 * margin,
                 height_m = (board.rows + more) * step + 2 * margin;
    Canvas canvas{cv::Mat(static_cast<int>(std::ceil(height_m * pixels_per_m)) + 2,
                          static_cast<int>(std::ceil(width_m * pixels_per_m)) + 2, CV_8U, cv::Scalar(255)),
                  pixels_per_m,
                  {margin * pixels_per_m, (height_m - margin) * pixels_per_m}};
    // Whole pixels, so that the squares' edges are exact.
    canvas.origin_px = {std::round(canvas.origin_px.x), std::round(canvas.origin_px.y)};
    if (april)
        draw_tags(board, dictionary, canvas);
    else
        draw_squares(board, dictionary, canvas);
    if (board.inverted) canvas.image = 255 - canvas.image;
    origin_px = canvas.origin_px;
    const std::size_t bytes = canvas.image.total();
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::memcpy(data.get(), canvas.image.data, bytes);
    return {canvas.image.cols, canvas.image.rows, 1, std::move(data)};
}

}  // namespace kinevox
