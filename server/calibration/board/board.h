// Calibration boards: specification and point coordinates. Board frame: metres, origin at the lower left
// corner of the print, x right, y up, z out of the print towards the observer. A camera that sees the print
// has z > 0.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <string_view>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

enum class BoardKind {
    kCheckerboard,  // points: inner corners
    kCharuco,       // points: inner corners
    kAprilGrid,     // points: four corners per tag
};

struct BoardSpec {
    BoardKind kind = BoardKind::kCharuco;
    int columns = 0, rows = 0;  // checkerboard: inner corners; ChArUco: squares; AprilGrid: tags
    double square_m = 0;        // edge of a square; AprilGrid: of a tag
    double marker_m = 0;        // ChArUco: edge of a marker; AprilGrid: gap between tags
    std::string dictionary;     // OpenCV's name of the marker dictionary; empty for a checkerboard
    bool inverted = false;      // printed white on black

    // Empty if usable, else one sentence.
    std::string check() const;

    // By id. Checkerboard and ChArUco: id = row * columns_of_corners + column, from the lower left corner.
    // AprilGrid: id = 4 * tag + corner, corners clockwise from the upper left, tags row by row from the lower
    // left.
    std::vector<Vec3> points() const;
    // True if a view determines the orientation of the board, so that cameras can be matched by it. False for
    // a checkerboard that is symmetric under half a turn.
    bool has_direction() const;

    bool operator==(const BoardSpec&) const = default;
};

// What an operator types, lengths in mm:
//   checkerboard:4x7:60                            inner corners, square
//   charuco:4x5:54:40.5:DICT_4X4_1000[:inverted]   squares, square, marker, dictionary
//   aprilgrid:6x6:88:26.4                          tags, tag, gap; family 36h11
// InvalidArgument with what is wrong and an example.
absl::StatusOr<BoardSpec> parse_board(std::string_view text);
std::string board_text(const BoardSpec& board);

}  // namespace kinevox
