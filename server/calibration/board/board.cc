#include "server/calibration/board/board.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

#include "common/one_line.h"

namespace kinevox {
namespace {

constexpr std::string_view kExamples =
    "write checkerboard:4x7:60 (inner corners, square in mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] "
    "(squares, square, marker) or aprilgrid:6x6:88:26.4 (tags, tag, gap)";

std::vector<std::string_view> split(std::string_view text, char by) {
    std::vector<std::string_view> parts;
    for (std::size_t at = 0; at <= text.size();) {
        const std::size_t end = std::min(text.find(by, at), text.size());
        parts.push_back(text.substr(at, end - at));
        at = end + 1;
    }
    return parts;
}

template <class T>
bool read_number(std::string_view text, T& value) {
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    return code == std::errc{} && end == text.data() + text.size();
}

}  // namespace

std::string BoardSpec::check() const {
    if (columns < 2 || rows < 2 || columns > 100 || rows > 100)
        return fmt::format("the board has {} x {} fields; 2 x 2 to 100 x 100 are allowed", columns, rows);
    if (kind != BoardKind::kAprilGrid && columns * rows < 6)
        return fmt::format("a board of {} x {} has too few corners; at least 2 x 3 are needed", columns,
                           rows);
    if (kind == BoardKind::kCharuco && (columns < 3 || rows < 3))
        return fmt::format(
            "a ChArUco board of {} x {} squares has too few corners; at least 3 x 3 are needed", columns,
            rows);
    if (!(square_m >= 0.001 && square_m <= 2))
        return fmt::format("the board's squares are {:g} mm; 1 to 2000 mm are allowed", 1000 * square_m);
    if (kind == BoardKind::kCharuco && !(marker_m > 0 && marker_m < square_m))
        return fmt::format("the markers are {:g} mm; they must be smaller than the squares of {:g} mm",
                           1000 * marker_m, 1000 * square_m);
    if (kind == BoardKind::kAprilGrid && !(marker_m >= 0 && marker_m <= square_m))
        return fmt::format("the gap between tags is {:g} mm; give 0 to the tag's {:g} mm", 1000 * marker_m,
                           1000 * square_m);
    return {};
}

std::vector<Vec3> BoardSpec::points() const {
    std::vector<Vec3> points;
    if (kind == BoardKind::kAprilGrid) {
        const double step = square_m + marker_m;
        for (int row = 0; row < rows; ++row)
            for (int column = 0; column < columns; ++column) {
                const double x = column * step, y = row * step;
                points.insert(
                    points.end(),
                    {{x, y + square_m, 0}, {x + square_m, y + square_m, 0}, {x + square_m, y, 0}, {x, y, 0}});
            }
        return points;
    }
    const int less = kind == BoardKind::kCharuco ? 1 : 0;
    for (int row = 0; row < rows - less; ++row)
        for (int column = 0; column < columns - less; ++column)
            points.push_back({(column + 1) * square_m, (row + 1) * square_m, 0});
    return points;
}

bool BoardSpec::has_direction() const {
    return kind != BoardKind::kCheckerboard || (columns + rows) % 2 == 1;
}

absl::StatusOr<BoardSpec> parse_board(std::string_view text) {
    const auto wrong = [&](std::string_view what) {
        return absl::InvalidArgumentError(
            one_line(fmt::format("board '{}': {}; {}", text.substr(0, 80), what.substr(0, 100), kExamples)));
    };
    const std::vector<std::string_view> parts = split(text, ':');
    BoardSpec board;
    std::size_t numbers = 1;
    if (parts[0] == "checkerboard") {
        board.kind = BoardKind::kCheckerboard;
    } else if (parts[0] == "charuco") {
        board.kind = BoardKind::kCharuco, numbers = 2;
    } else if (parts[0] == "aprilgrid") {
        board.kind = BoardKind::kAprilGrid, numbers = 2, board.dictionary = "DICT_APRILTAG_36h11";
    } else {
        return wrong("unknown kind of board");
    }
    std::size_t expected = 2 + numbers + (board.kind == BoardKind::kCharuco ? 1 : 0);
    if (parts.size() == expected + 1 && parts.back() == "inverted") {
        board.inverted = true;
    } else if (parts.size() != expected) {
        return wrong(fmt::format("expected {} fields separated by colons", expected));
    }
    const std::vector<std::string_view> size = split(parts[1], 'x');
    if (size.size() != 2 || !read_number(size[0], board.columns) || !read_number(size[1], board.rows))
        return wrong(fmt::format("'{}' is not a size such as 4x7", parts[1]));
    if (!read_number(parts[2], board.square_m))
        return wrong(fmt::format("'{}' is not a length in mm", parts[2]));
    if (numbers == 2 && !read_number(parts[3], board.marker_m))
        return wrong(fmt::format("'{}' is not a length in mm", parts[3]));
    board.square_m /= 1000, board.marker_m /= 1000;
    if (board.kind == BoardKind::kCharuco) board.dictionary = std::string(parts[4]);
    if (const std::string problem = board.check(); !problem.empty()) return wrong(problem);
    return board;
}

std::string board_text(const BoardSpec& b) {
    std::string text;
    switch (b.kind) {
        case BoardKind::kCheckerboard:
            text = fmt::format("checkerboard:{}x{}:{:g}", b.columns, b.rows, 1000 * b.square_m);
            break;
        case BoardKind::kCharuco:
            text = fmt::format("charuco:{}x{}:{:g}:{:g}:{}", b.columns, b.rows, 1000 * b.square_m,
                               1000 * b.marker_m, b.dictionary);
            break;
        case BoardKind::kAprilGrid:
            text = fmt::format("aprilgrid:{}x{}:{:g}:{:g}", b.columns, b.rows, 1000 * b.square_m,
                               1000 * b.marker_m);
            break;
    }
    return b.inverted ? text + ":inverted" : text;
}

}  // namespace kinevox
