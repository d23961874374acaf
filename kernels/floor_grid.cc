#include "kernels/floor_grid.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/shared/kde_shadow.h"

namespace kinevox::kernels {
namespace {

// Inverts distort() by fixed-point iteration; false where it does not converge.
bool undistort(const Projector& camera, float u, float v, float& x, float& y) {
    constexpr int kSteps = 30;
    constexpr float kMaxError = 1e-3f;  // of the normalised image, about half a pixel
    const float target_x = (u - camera.cx) / camera.fx, target_y = (v - camera.cy) / camera.fy;
    x = target_x, y = target_y;
    if (!camera.distorted) return true;
    float error = 0;
    for (int step = 0; step < kSteps; ++step) {
        float distorted_x = x, distorted_y = y;
        distort(camera, distorted_x, distorted_y);
        const float dx = target_x - distorted_x, dy = target_y - distorted_y;
        x += dx, y += dy;
        error = std::hypot(dx, dy);
    }
    return error < kMaxError && x * x + y * y < camera.max_radius2;
}

}  // namespace

FloorDirections floor_directions(const CameraModel& model) {
    const Projector camera = make_projector(model, "floor");
    FloorDirections out;
    out.columns = camera.width / kde::kFloorGrid_px + 2;
    out.rows = camera.height / kde::kFloorGrid_px + 2;
    for (int i = 0; i < 3; ++i)
        out.centre[i] =
            -(camera.r[i] * camera.t[0] + camera.r[3 + i] * camera.t[1] + camera.r[6 + i] * camera.t[2]);
    for (int row = 0; row < out.rows; ++row)
        for (int column = 0; column < out.columns; ++column) {
            float x, y;
            if (!undistort(camera, static_cast<float>(column * kde::kFloorGrid_px),
                           static_cast<float>(row * kde::kFloorGrid_px), x, y))
                x = y = std::numeric_limits<float>::quiet_NaN();  // every comparison with it is false
            out.xy.push_back(x);
            out.xy.push_back(y);
        }
    return out;
}

void subject_bounds(const Rect& subject, const CameraModel& camera, const FloorDirections& directions,
                    float bounds[4]) {
    kde::bounds_around(subject, camera.width, camera.height, directions.xy.data(), directions.columns,
                       directions.rows, bounds);
}

}  // namespace kinevox::kernels
