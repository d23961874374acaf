// Finds a board's points in a picture.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct Corner {
    int id = 0;  // index into BoardSpec::points()
    Vec2 pixel;
};

struct BoardSighting {
    std::vector<Corner> corners;    // sorted by id; empty: the board was not found
    double edge_px = 0;             // how wide the print's edges are blurred, px; about 2 is sharp
    bool mirrored_picture = false;  // not found, but found in the picture's mirror image

    bool found() const { return !corners.empty(); }
};

// Not thread safe; one a thread.
class BoardDetector {
  public:
    // InvalidArgument for a board that cannot be, or a dictionary that OpenCV does not know.
    static absl::StatusOr<std::unique_ptr<BoardDetector>> create(const BoardSpec& board);
    virtual ~BoardDetector() = default;

    virtual BoardSighting detect(const Picture& picture) = 0;
    virtual const BoardSpec& board() const = 0;

    // The print, grey, `pixels_per_m` fine, with a margin of one square all around (AprilGrid: of one gap):
    // for printing, and for the virtual studio. `origin_px` becomes where the board frame's origin lies, px
    // from the upper left pixel's corner.
    virtual Picture draw(double pixels_per_m, Vec2& origin_px) const = 0;
};

}  // namespace kinevox
