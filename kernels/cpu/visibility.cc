#include "kernels/cpu/visibility.h"

#include <algorithm>
#include <cmath>

#include "kernels/cpu/project_lanes.h"
#include "kernels/cpu/sixteen_lanes.h"

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

// The products are fused as the compiler fuses those of project_body(): the same bits.
KINEVOX_AVX512 void project_avx512(const Surface& surface, int first, int last, ViewOfVolume& view) {
    const Projector c = view.camera;
    for (int n = first; n < last; n += 16) {
        const auto here = static_cast<__mmask16>(last - n < 16 ? (1u << (last - n)) - 1 : 0xffff);
        const __m512 x = _mm512_maskz_loadu_ps(here, &surface.x_m[n]);
        const __m512 y = _mm512_maskz_loadu_ps(here, &surface.y_m[n]);
        const __m512 z = _mm512_maskz_loadu_ps(here, &surface.z_m[n]);
        __m512 at[3];
        for (int axis = 0; axis < 3; ++axis) {
            const float* r = c.r + static_cast<std::ptrdiff_t>(3) * axis;
            const __m512 across =
                _mm512_fmadd_ps(sixteen::all(r[0]), x, _mm512_mul_ps(sixteen::all(r[1]), y));
            at[axis] = _mm512_add_ps(_mm512_fmadd_ps(sixteen::all(r[2]), z, across), sixteen::all(c.t[axis]));
        }
        const sixteen::Pixels pixels = sixteen::project(c, at[0], at[1], at[2]);
        const auto cell_of = [&](__m512 u, int first_cell) KINEVOX_AVX512 {
            return _mm512_sub_epi32(_mm512_srav_epi32(sixteen::index(u), sixteen::all(view.shift)),
                                    sixteen::all(first_cell));
        };
        const __m512i column = cell_of(pixels.u, view.cells.x0), row = cell_of(pixels.v, view.cells.y0);
        // Negative ones are larger than any as numbers without a sign.
        const __m512i width = sixteen::all(view.cells.width()), height = sixteen::all(view.cells.height());
        const __mmask16 inside = _mm512_mask_cmplt_epu32_mask(
            _mm512_mask_cmplt_epu32_mask(pixels.seen, column, width), row, height);
        const __m512i cell =
            _mm512_mask_add_epi32(sixteen::all(-1), inside, _mm512_mullo_epi32(row, width), column);
        _mm512_mask_storeu_epi32(&view.cell[n], here, cell);
        _mm512_mask_storeu_ps(&view.depth_m[n], here, at[2]);
    }
}
#endif

void project_surface(const Surface& surface, int first, int last, ViewOfVolume& view) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx512()) return project_avx512(surface, first, last, view);
    if (have_avx2()) return project_avx2(surface, first, last, view);
#endif
    project_plain(surface, first, last, view);
}

// out[x] = minimum of in[x - radius .. x + radius] for cells x in [first, last) of a row of `width` cells.
KINEVOX_INLINE void widen_row(const DepthCell* in, int width, int first, int last, int radius,
                              DepthCell* out) {
    std::copy(in + first, in + last, out + first);
    const auto take = [&](int begin, int end, int shift) __attribute__((always_inline)) {
        for (int x = begin; x < end; ++x) out[x] = nearer(out[x], in[x + shift]);
    };
    for (int shift = 1; shift <= radius; ++shift) {
        take(first, std::min(last, width - shift), shift);
        take(std::max(first, shift), last, -shift);
    }
}

// Each cell takes the minimum of the (2 * radius + 1)^2 around it.
KINEVOX_INLINE void widen_body(ViewOfVolume& view) {
    const int width = view.cells.width(), height = view.cells.height(), radius = view.radius;
    const int kept = 2 * radius + 1;  // rows that were widened along themselves
    view.scratch.resize(static_cast<std::size_t>(kept) * width);
    const auto row_of = [&](int y) __attribute__((always_inline)) {
        return view.depths.data() + static_cast<std::size_t>(y) * width;
    };
    const auto widened = [&](int y) __attribute__((always_inline)) {
        return view.scratch.data() + static_cast<std::size_t>(y % kept) * width;
    };
    for (int coming = 0; coming < height + radius; ++coming) {
        if (coming < height && view.spans[coming].first < view.spans[coming].last) {
            const RowSpan span = view.spans[coming];
            widen_row(row_of(coming), width, span.first, span.last, radius, widened(coming));
        }
        const int y = coming - radius;
        if (y < 0 || view.spans[y].first >= view.spans[y].last) continue;
        const RowSpan span = view.spans[y];
        DepthCell* const out = row_of(y);
        std::copy(widened(y) + span.first, widened(y) + span.last, out + span.first);
        for (int from = std::max(0, y - radius); from <= std::min(height - 1, y + radius); ++from) {
            const DepthCell* const in = widened(from);
            const int first = std::max(span.first, view.spans[from].first);
            const int last = std::min(span.last, view.spans[from].last);
            for (int x = first; from != y && x < last; ++x) out[x] = nearer(out[x], in[x]);
        }
    }
}

void widen_plain(ViewOfVolume& view) {
    widen_body(view);
}

#ifdef KINEVOX_HAVE_AVX2_FORM
KINEVOX_AVX2 void widen_avx2(ViewOfVolume& view) {
    widen_body(view);
}
#endif

void widen(ViewOfVolume& view) {
#ifdef KINEVOX_HAVE_AVX2_FORM
    if (have_avx2()) return widen_avx2(view);
#endif
    widen_plain(view);
}

// The filled cells of each row, widened by view.radius.
void find_spans(ViewOfVolume& view) {
    const int width = view.cells.width(), height = view.cells.height(), radius = view.radius;
    std::vector<RowSpan> filled(height);
    for (int y = 0; y < height; ++y) {
        const DepthCell* const row = view.depths.data() + static_cast<std::size_t>(y) * width;
        int first = 0, last = width;
        while (first < last && row[first].empty()) ++first;
        while (first < last && row[last - 1].empty()) --last;
        filled[y] = {first, last};
    }
    view.spans.assign(height, {width, 0});
    for (int y = 0; y < height; ++y) {
        if (filled[y].first >= filled[y].last) continue;
        for (int near = std::max(0, y - radius); near <= std::min(height - 1, y + radius); ++near) {
            RowSpan& span = view.spans[near];
            span.first = std::min(span.first, std::max(0, filled[y].first - radius));
            span.last = std::max(span.last, std::min(width, filled[y].last + radius));
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
        const float x = lattice.origin[0] + (brick.x + 0.5f) * edge,
                    y = lattice.origin[1] + (brick.y + 0.5f) * edge,
                    z = lattice.origin[2] + (brick.z + 0.5f) * edge;
        float depth_m;
        if (!frame_brick(c, x, y, z, edge, px, depth_m)) continue;
        depth += depth_m;
        ++seen;
    }
    finish_frame(lattice.voxel_m, px, depth, seen, view);
    for (unsigned open = 0; open < 64; ++open) {
        float normal[3];
        open_normal(open, normal);
        view.facing[open] = facing_of(c, normal);
        view.behind_m[open] = seen_within(view.facing[open], lattice.voxel_m);
    }
}

void finish_frame(float voxel_m, Rect px, double depth_sum_m, int seen, ViewOfVolume& view) {
    const Projector& c = view.camera;
    const float voxel_px =
        seen ? std::max(c.fx, c.fy) * voxel_m / static_cast<float>(depth_sum_m / seen) : 1.f;
    view.shift = cell_shift(voxel_px);
    px.x0 = std::max(px.x0, 0), px.x1 = std::min(px.x1, c.width);
    px.y0 = std::max(px.y0, 0), px.y1 = std::min(px.y1, c.height);
    view.cells = {};
    if (px.empty()) return;
    view.cells = {px.x0 >> view.shift, px.y0 >> view.shift, ((px.x1 - 1) >> view.shift) + 1,
                  ((px.y1 - 1) >> view.shift) + 1};
}

void look_at_surface(const Surface& surface, float voxel_m, bool first_look, ViewOfVolume& view) {
    constexpr int kTogether = 1024;  // voxels that are still in the cache when they are splatted
    static_assert(kTogether % kLanes == 0);
    view.cell.resize(surface.x_m.size());
    view.depth_m.resize(surface.x_m.size());
    if (first_look) {
        view.depths.assign(view.cell_count(), DepthCell{});
    } else {
        for (std::size_t y = 0; y < view.spans.size(); ++y) {
            const RowSpan span = view.spans[y];
            DepthCell* const row = view.depths.data() + y * view.cells.width();
            if (span.first < span.last) std::fill(row + span.first, row + span.last, DepthCell{});
        }
    }
    float nearest = kFar_m;
    DepthCell* const depths = view.depths.data();
    for (int first = 0; first < surface.size(); first += kTogether) {
        const int last = std::min(first + kTogether, surface.size());
        project_surface(surface, first, last, view);
        for (int n = first; n < last; ++n) {
            const int cell = view.cell[n];
            if (cell < 0) continue;
            const float depth = view.depth_m[n];
            nearest = nearest < depth ? nearest : depth;
            // Written whether it changes or not: a branch here is mispredicted every third time.
            depths[cell] = nearer(depths[cell], {depth, -depth});
        }
    }
    view.radius = splat_radius(view.camera, view.shift, nearest, voxel_m);
    if (first_look) find_spans(view);
    if (view.radius > 0) widen(view);
}

}  // namespace kinevox::kernels
