// Eight points of a row through one camera; the vector form of to_camera(), distort() and to_index().
#pragma once

#include "kernels/cpu/simd.h"
#include "kernels/shared/camera.h"

namespace kinevox::kernels {

struct LanePixels {
    Floats u, v;  // px, within +-30000
    Ints seen;    // -1 where the camera looks that way, else 0
};

KINEVOX_INLINE LanePixels project_lanes(const Projector& c, const Floats& px, const Floats& py,
                                        const Floats& pz) {
    const Floats w = 1.f / pz;
    Floats x = px * w, y = py * w;
    const Floats r2 = x * x + y * y;
    LanePixels out;
    out.seen = (pz > kNearest_m) & (r2 < c.max_radius2);
    if (c.distorted) {
        const Floats radial = 1.f + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
        const Floats xy = x * y;
        const Floats xd = x * radial + 2 * c.p1 * xy + c.p2 * (r2 + 2.f * x * x);
        const Floats yd = y * radial + c.p1 * (r2 + 2.f * y * y) + 2 * c.p2 * xy;
        x = xd;
        y = yd;
    }
    const Floats u = c.fx * x + c.cx, v = c.fy * y + c.cy;
    const Floats low = splat(-30000.f), high = splat(30000.f);
    out.u = u > low ? (u < high ? u : high) : low;  // a NaN becomes low
    out.v = v > low ? (v < high ? v : high) : low;
    return out;
}

KINEVOX_INLINE Ints lane_index(const Floats& u) {
    return to_ints(u + 32768.5f) - 32768;
}

}  // namespace kinevox::kernels
