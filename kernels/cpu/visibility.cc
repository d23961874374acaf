#include "kernels/cpu/visibility.h"

#include <algorithm>
#include <cmath>

#include "kernels/cpu/project_lanes.h"

namespace kinevox::kernels {
namespace {

KINEVOX_INLINE void project_body(const Surface& surface, int first, int last, ViewOfVolume& view) {
    const int width = view.cells.width(), height = view.cells.height();
    const Projector c = view.camera;
    for (int n = first; n < last; n += kLanes) {
        Floats x, y, z;
        std::memcpy(&x, &surface.x_m[n], sizeof(x));
        std::memcpy(&y, &surface.y_m[n], sizeof(y));
        std::memcpy(&z, &surface.z_m[n], sizeof(z));
        const Floats depth = c.r[6] * x + c.r[7] * y + c.r[8] * z + c.t[2];
        const LanePixels at = project_lanes(c, c.r[0] * x + c.r[1] * y + c.r[2] * z + c.t[0],
                                            c.r[3] * x + c.r[4] * y + c.r[5] * z + c.t[1], depth);
        const Ints column = (lane_index(at.u) >> view.shift) - view.cells.x0;
        const Ints row = (lane_index(at.v) >> view.shift) - view.cells.y0;
        const Ints inside = at.seen & (column >= 0) & (row >= 0) & (column < width) & (row < height);
        const Ints cell = ((row * width + column) & inside) | ~inside;  // -1 outside
        std::memcpy(&view.cell[n], &cell, sizeof(cell));
        std::memcpy(&view.depth_m[n], &depth, sizeof(depth));
    }
}

void project_plain(const Surface& surface, int first, int last, ViewOfVolume& view) {
    project_body(surface, first, last, view);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void project_avx2(const Surface& surface, int first, int last, ViewOfVolume& view) {
    project_body(surface, first, last, view);
}
#endif

// Each cell takes the best of the (2 * reach + 1)^2 around it.
template <class Best>
void widen(std::vector<float>& picture, int width, int height, int reach, float nothing, std::vector<float>& scratch,
           Best best) {
    scratch.resize(picture.size());
    for (int y = 0; y < height; ++y) {
        const float* in = picture.data() + static_cast<std::size_t>(y) * width;
        float* out = scratch.data() + static_cast<std::size_t>(y) * width;
        std::copy_n(in, width, out);
        for (int shift = 1; shift <= reach && shift < width; ++shift) {
            for (int x = 0; x < width - shift; ++x) out[x] = best(out[x], in[x + shift]);
            for (int x = shift; x < width; ++x) out[x] = best(out[x], in[x - shift]);
        }
    }
    for (int y = 0; y < height; ++y) {
        float* out = picture.data() + static_cast<std::size_t>(y) * width;
        std::fill_n(out, width, nothing);
        for (int from = std::max(0, y - reach); from <= std::min(height - 1, y + reach); ++from) {
            const float* in = scratch.data() + static_cast<std::size_t>(from) * width;
            for (int x = 0; x < width; ++x) out[x] = best(out[x], in[x]);
        }
    }
}

}  // namespace

void frame_view(const VoxelVolume& volume, ViewOfVolume& view) {
    const Projector& c = view.camera;
    const Lattice& lattice = volume.lattice;
    const float edge = kBrickEdge * lattice.voxel_m;
    Rect px{c.width, c.height, 0, 0};
    double depth = 0;
    int seen = 0;
    for (const Brick& brick : volume.bricks) {
        const float x = lattice.origin[0] + (brick.x + 0.5f) * edge, y = lattice.origin[1] + (brick.y + 0.5f) * edge,
                    z = lattice.origin[2] + (brick.z + 0.5f) * edge;
        float depth_m;
        if (!frame_brick(c, x, y, z, edge, px, depth_m)) continue;
        depth += depth_m;
        ++seen;
    }
    finish_frame(lattice.voxel_m, px, depth, seen, view);
}

void finish_frame(float voxel_m, Rect px, double depth_sum_m, int seen, ViewOfVolume& view) {
    const Projector& c = view.camera;
    const float voxel_px = seen ? std::max(c.fx, c.fy) * voxel_m / static_cast<float>(depth_sum_m / seen) : 1.f;
    view.shift = std::clamp(static_cast<int>(std::floor(std::log2(std::max(voxel_px, 1.f) / 0.9f))), 0, 6);
    px.x0 = std::max(px.x0, 0), px.x1 = std::min(px.x1, c.width);
    px.y0 = std::max(px.y0, 0), px.y1 = std::min(px.y1, c.height);
    view.cells = {};
    if (px.empty()) return;
    view.cells = {px.x0 >> view.shift, px.y0 >> view.shift, ((px.x1 - 1) >> view.shift) + 1,
                  ((px.y1 - 1) >> view.shift) + 1};
}

void make_room(const Surface& surface, ViewOfVolume& view) {
    view.cell.resize(surface.x_m.size());
    view.depth_m.resize(surface.x_m.size());
}

void project_surface(const Surface& surface, int first, int last, ViewOfVolume& view) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return project_avx2(surface, first, last, view);
#endif
    project_plain(surface, first, last, view);
}

void splat_depth(const Surface& surface, float voxel_m, ViewOfVolume& view) {
    view.front_m.assign(view.cell_count(), kFar_m);
    view.back_m.assign(view.cell_count(), 0);
    const int count = surface.size();
    float nearest = kFar_m;
    float* const front = view.front_m.data();
    float* const back = view.back_m.data();
    for (int n = 0; n < count; ++n) {
        const int cell = view.cell[n];
        if (cell < 0) continue;
        const float depth = view.depth_m[n];
        nearest = nearest < depth ? nearest : depth;
        // Written whether it changes or not: a branch here is mispredicted every third time.
        front[cell] = front[cell] < depth ? front[cell] : depth;
        back[cell] = back[cell] > depth ? back[cell] : depth;
    }
    view.reach = splat_reach_of(view.camera, view.shift, nearest, voxel_m);
    if (view.reach == 0) return;
    const int width = view.cells.width(), height = view.cells.height();
    widen(view.front_m, width, height, view.reach, kFar_m, view.scratch, [](float a, float b) { return a < b ? a : b; });
    widen(view.back_m, width, height, view.reach, 0, view.scratch, [](float a, float b) { return a > b ? a : b; });
}

}  // namespace kinevox::kernels
