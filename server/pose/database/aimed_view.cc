#include "server/pose/database/aimed_view.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "kernels/shared/camera.h"

namespace kinevox {
namespace {

constexpr int kNodePx =
    8;  // the mapping to the real image is computed at every eighth pixel and interpolated

struct Node {
    float u = 0, v = 0;
    bool seen = false;
};

class RealFromAimed {
  public:
    RealFromAimed(const kernels::CameraModel& real, const kernels::CameraModel& aimed)
        : projector_(kernels::make_projector(real, "pose database: camera")), aimed_(aimed) {
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) {
                real_from_aimed_[3 * r + c] = 0;
                for (int k = 0; k < 3; ++k)
                    real_from_aimed_[3 * r + c] += real.rotation_camera_from_world[3 * r + k] *
                                                   aimed.rotation_camera_from_world[3 * c + k];
            }
    }

    Node at(int x, int y) const {
        const float dx = (static_cast<float>(x) - aimed_.cx) / aimed_.fx;
        const float dy = (static_cast<float>(y) - aimed_.cy) / aimed_.fy;
        const float* r = real_from_aimed_;
        Node node;
        node.seen = kernels::to_pixel(
            projector_,
            {r[0] * dx + r[1] * dy + r[2], r[3] * dx + r[4] * dy + r[5], r[6] * dx + r[7] * dy + r[8]},
            node.u, node.v);
        return node;
    }

  private:
    kernels::Projector projector_;
    const kernels::CameraModel& aimed_;
    float real_from_aimed_[9];
};

// Whether a cell may overlap a box.
bool touches(const Node* const corners[4], const kernels::Rect& box) {
    float u0 = 1e9f, u1 = -1e9f, v0 = 1e9f, v1 = -1e9f;
    for (int n = 0; n < 4; ++n) {
        if (!corners[n]->seen) return false;
        u0 = std::min(u0, corners[n]->u), u1 = std::max(u1, corners[n]->u);
        v0 = std::min(v0, corners[n]->v), v1 = std::max(v1, corners[n]->v);
    }
    return u1 > static_cast<float>(box.x0 - 1) && u0 < static_cast<float>(box.x1) &&
           v1 > static_cast<float>(box.y0 - 1) && v0 < static_cast<float>(box.y1);
}

}  // namespace

Vec3 camera_centre(const kernels::CameraModel& camera) {
    const float* r = camera.rotation_camera_from_world;
    const float* t = camera.translation_camera_from_world;
    return {-(r[0] * t[0] + r[3] * t[1] + r[6] * t[2]), -(r[1] * t[0] + r[4] * t[1] + r[7] * t[2]),
            -(r[2] * t[0] + r[5] * t[1] + r[8] * t[2])};
}

AimedView aimed_view(Vec3 eye, Vec3 target, double half_width_m, int side_px) {
    AimedView view;
    const Vec3 out = eye - target;
    const double flat = std::hypot(out.x, out.y);
    view.distance_m = std::max(norm(out), 0.1);
    view.azimuth = flat > 1e-9 ? std::atan2(out.y, out.x) : 0;
    view.elevation = std::atan2(out.z, flat);
    view.metres_per_px = 2 * half_width_m / side_px;
    const double ca = std::cos(view.azimuth), sa = std::sin(view.azimuth);
    const double ce = std::cos(view.elevation), se = std::sin(view.elevation);
    const Vec3 forward{-ce * ca, -ce * sa, -se};
    view.right = {-sa, ca, 0};
    view.down = cross(forward, view.right);
    const Vec3 rows[3] = {view.right, view.down, forward};
    kernels::CameraModel& camera = view.camera;
    camera.width = camera.height = side_px;
    camera.cx = camera.cy = 0.5f * static_cast<float>(side_px - 1);
    camera.fx = camera.fy = static_cast<float>(view.distance_m / view.metres_per_px);
    for (int r = 0; r < 3; ++r) {
        const double row[3] = {rows[r].x, rows[r].y, rows[r].z};
        for (int k = 0; k < 3; ++k) camera.rotation_camera_from_world[3 * r + k] = static_cast<float>(row[k]);
        camera.translation_camera_from_world[r] = static_cast<float>(-dot(rows[r], eye));
    }
    return view;
}

void rectify_silhouette(const kernels::CameraModel& camera, const std::uint8_t* silhouette,
                        const kernels::Rect& bounds, const AimedView& view, AimedSilhouette& out) {
    const int side = view.camera.width;
    out.mask.assign(static_cast<std::size_t>(side) * side, 0);
    out.bounds = {side, side, 0, 0};
    out.pixels = 0;
    out.truncated = false;
    // A silhouette at the image border is truncated where it is within one pixel of this view from the
    // border.
    const int margin_px =
        1 + static_cast<int>(std::max(camera.fx, camera.fy) * view.metres_per_px / view.distance_m);
    const int left = bounds.x0 == 0 ? margin_px : 0, top = bounds.y0 == 0 ? margin_px : 0;
    const int right = camera.width - (bounds.x1 >= camera.width ? margin_px : 0);
    const int bottom = camera.height - (bounds.y1 >= camera.height ? margin_px : 0);
    const RealFromAimed way(camera, view.camera);
    const int cells = (side + kNodePx - 1) / kNodePx;
    std::vector<Node> nodes(static_cast<std::size_t>(cells + 1) * (cells + 1));
    for (int j = 0; j <= cells; ++j)
        for (int i = 0; i <= cells; ++i) nodes[j * (cells + 1) + i] = way.at(i * kNodePx, j * kNodePx);
    for (int j = 0; j < cells; ++j) {
        for (int i = 0; i < cells; ++i) {
            const Node* a = &nodes[j * (cells + 1) + i];
            const Node* const corners[4] = {a, a + 1, a + cells + 1, a + cells + 2};
            if (!touches(corners, bounds)) continue;
            for (int y = j * kNodePx; y < std::min((j + 1) * kNodePx, side); ++y) {
                const float t = static_cast<float>(y % kNodePx) / kNodePx;
                const float u0 = a->u + t * (corners[2]->u - a->u),
                            u1 = corners[1]->u + t * (corners[3]->u - corners[1]->u);
                const float v0 = a->v + t * (corners[2]->v - a->v),
                            v1 = corners[1]->v + t * (corners[3]->v - corners[1]->v);
                const float du = (u1 - u0) / kNodePx, dv = (v1 - v0) / kNodePx;
                std::uint8_t* row = out.mask.data() + static_cast<std::size_t>(y) * side;
                for (int x = i * kNodePx; x < std::min((i + 1) * kNodePx, side); ++x) {
                    const float s = static_cast<float>(x % kNodePx);
                    const int column = kernels::to_index(u0 + s * du), line = kernels::to_index(v0 + s * dv);
                    if (column < bounds.x0 || column >= bounds.x1 || line < bounds.y0 || line >= bounds.y1)
                        continue;
                    if (!silhouette[static_cast<std::size_t>(line) * camera.width + column]) continue;
                    row[x] = 255;
                    ++out.pixels;
                    out.truncated |= column < left || line < top || column >= right || line >= bottom;
                    out.bounds = {std::min(out.bounds.x0, x), std::min(out.bounds.y0, y),
                                  std::max(out.bounds.x1, x + 1), std::max(out.bounds.y1, y + 1)};
                }
            }
        }
    }
    if (out.pixels == 0) out.bounds = {};
}

}  // namespace kinevox
