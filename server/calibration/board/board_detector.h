// Detects a board's points in an image.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct Corner {
    int id = 0;  // index into BoardSpec::points()
    Vec2 pixel;
};

struct BoardDetection {
    std::vector<Corner> corners;  // sorted by id; empty: not detected
    double edge_px = 0;           // width of the print's edges, px; about 2 is sharp
    bool mirrored_image = false;  // not detected, but detected in the mirrored image

    bool found() const { return !corners.empty(); }
};

// Not thread safe; one per thread.
class BoardDetector {
  public:
    // InvalidArgument for an invalid board or an unknown dictionary.
    static absl::StatusOr<std::unique_ptr<BoardDetector>> create(const BoardSpec& board);
    virtual ~BoardDetector() = default;

    virtual BoardDetection detect(const Image& image) = 0;
    virtual const BoardSpec& board() const = 0;

    // The print in grey with `pixels_per_m`, with a margin of one square (AprilGrid: one gap), for printing
    // and for the virtual studio. `origin_px` receives the position of the board frame's origin, px from the
    // corner of the upper left pixel.
    virtual Image draw(double pixels_per_m, Vec2& origin_px) const = 0;
};

}  // namespace kinevox
