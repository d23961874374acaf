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
    constexpr float kMargin = 0.3f;  // of the subject's longer side
    constexpr float kBeyond = 1e3f;
    const int margin =
        kde::kFloorGrid_px +
        static_cast<int>(kMargin * static_cast<float>(std::max(subject.width(), subject.height())));
    const int x0 = subject.x0 - margin, y0 = subject.y0 - margin, x1 = subject.x1 + margin,
              y1 = subject.y1 + margin;
    const int last_column = directions.columns - 1, last_row = directions.rows - 1;
    const auto grid_at = [](int px, int last) { return std::clamp(px / kde::kFloorGrid_px, 0, last); };
    const int columns[3] = {grid_at(x0, last_column), grid_at((x0 + x1) / 2, last_column),
                            grid_at(x1 + kde::kFloorGrid_px - 1, last_column)};
    const int rows[3] = {grid_at(y0, last_row), grid_at((y0 + y1) / 2, last_row),
                         grid_at(y1 + kde::kFloorGrid_px - 1, last_row)};
    bounds[0] = bounds[2] = kBeyond;
    bounds[1] = bounds[3] = -kBeyond;
    bool known = true;
    for (const int row : rows)
        for (const int column : columns) {
            const float* xy =
                directions.xy.data() + 2 * (static_cast<std::size_t>(row) * directions.columns + column);
            known = known && xy[0] == xy[0];
            bounds[0] = std::min(bounds[0], xy[0]);
            bounds[1] = std::max(bounds[1], xy[0]);
            bounds[2] = std::min(bounds[2], xy[1]);
            bounds[3] = std::max(bounds[3], xy[1]);
        }
    if (!known || x0 <= 0) bounds[0] = -kBeyond;
    if (!known || x1 >= camera.width) bounds[1] = kBeyond;
    if (!known || y0 <= 0) bounds[2] = -kBeyond;
    if (!known || y1 >= camera.height) bounds[3] = kBeyond;
}

}  // namespace kinevox::kernels
