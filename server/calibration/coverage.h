// How much of the images and of the capture volume the calibration covers.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/geometry.h"

namespace kinevox {

// Fraction of a camera's image in which target points were detected.
class Coverage {
  public:
    static constexpr int kColumns = 8, kRows = 6;

    Coverage(int width, int height) : width_(width), height_(height), counts_(kColumns * kRows, 0) {}

    void add(Vec2 pixel);
    // True if any of them lies in an empty cell.
    bool is_new(const std::vector<Vec2>& pixels) const;
    // Non-empty cells, 0 to 1.
    double fraction() const;
    // Points per cell, row by row from the upper left.
    const std::vector<int>& counts() const { return counts_; }
    // Name of the image region with the most empty cells: "the upper left"; empty at full coverage.
    std::string emptiest() const;

  private:
    int cell(Vec2 pixel) const;
    int width_, height_;
    std::vector<int> counts_;
};

// Coverage of the capture volume by the cameras' views and by the target points seen while calibrating.
struct VolumeCoverage {
    Vec3 lower, upper;             // m, world: the box
    double two_view_fraction = 0;  // fraction seen by two or more cameras, 0 to 1
    double three_view_fraction = 0;
    double calibrated_fraction = 0;  // fraction near a target point seen by two or more cameras
};

// `points`: target points, m. An empty box (upper not above lower) is replaced by their bounding box.
VolumeCoverage volume_coverage(const std::vector<Camera>& cameras, const std::vector<Vec3>& points,
                               Vec3 lower, Vec3 upper);

// The same for the box around the target points with a known floor: from the floor up to at least a person's
// raised hands. Empty for fewer than three points.
std::optional<VolumeCoverage> working_volume(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& points);

}  // namespace kinevox
