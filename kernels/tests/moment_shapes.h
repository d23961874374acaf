// Masks of shapes for the tests of the moments, their borders anti-aliased.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "kernels/moments.h"

namespace kinevox::kernels::testing {

struct ShapeMask {
    int width = 0, height = 0;
    std::vector<std::uint8_t> pixels;

    MomentView view() const { return {pixels.data(), width, {0, 0, width, height}, {}}; }
    MomentView view(DiskMapping mapping) const {
        return {pixels.data(), width, {0, 0, width, height}, mapping};
    }
};

// `inside(x, y)` in pixels, the first pixel's centre at (0, 0); 8 x 8 samples a pixel.
template <class F>
ShapeMask draw_shape(int width, int height, F inside) {
    ShapeMask mask{width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width) * height)};
    constexpr int kSamples = 8;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            int hits = 0;
            for (int j = 0; j < kSamples; ++j)
                for (int i = 0; i < kSamples; ++i)
                    hits += inside(x + (i + 0.5) / kSamples - 0.5, y + (j + 0.5) / kSamples - 0.5);
            mask.pixels[static_cast<std::size_t>(y) * width + x] =
                static_cast<std::uint8_t>(std::lround(255.0 * hits / (kSamples * kSamples)));
        }
    }
    return mask;
}

// Signed distance to a person of about two units' height standing at (0, 0), one arm out, y down: nothing
// about it is symmetric.
inline double figure_distance(double x, double y) {
    const auto line = [&](double ax, double ay, double bx, double by, double radius) {
        const double dx = bx - ax, dy = by - ay;
        double t = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy);
        t = t < 0 ? 0 : (t > 1 ? 1 : t);
        const double ex = x - ax - t * dx, ey = y - ay - t * dy;
        return std::sqrt(ex * ex + ey * ey) - radius;
    };
    return std::min({line(0, -0.85, 0, -0.78, 0.13), line(0, -0.5, 0, 0.05, 0.2),
                     line(0.1, 0.1, 0.2, 0.95, 0.09), line(-0.1, 0.1, -0.3, 0.5, 0.09),
                     line(-0.3, 0.5, -0.15, 0.9, 0.08), line(0.2, -0.55, 0.7, -0.6, 0.06),
                     line(0.7, -0.6, 0.9, -0.95, 0.05), line(-0.2, -0.5, -0.35, 0.1, 0.06)});
}

inline ShapeMask draw_figure(int width, int height, double x0, double y0, double scale_px, double turn = 0) {
    const double c = std::cos(turn), s = std::sin(turn);
    ShapeMask mask{width, height, std::vector<std::uint8_t>(static_cast<std::size_t>(width) * height)};
    for (int v = 0; v < height; ++v) {
        for (int u = 0; u < width; ++u) {
            const double x = (u - x0) / scale_px, y = (v - y0) / scale_px;
            const double coverage = 0.5 - scale_px * figure_distance(c * x + s * y, -s * x + c * y);
            mask.pixels[static_cast<std::size_t>(v) * width + u] =
                static_cast<std::uint8_t>(std::lround(255 * std::clamp(coverage, 0.0, 1.0)));
        }
    }
    return mask;
}

}  // namespace kinevox::kernels::testing
