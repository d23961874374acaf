#include "kernels/distance_map.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/cpu/dispatch.h"

// Plain loops over the cells of a row, which the compiler vectorises for each family that Highway chooses
// from.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/distance_map.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::HWY_NAMESPACE {

// Distances to the other kind within the columns, from one row to the next.
inline void extend(const std::uint8_t* inside, const std::uint8_t* inside_before, int columns,
                   std::int32_t* steps) {
    for (int c = 0; c < columns; ++c) {
        const bool same = (inside[c] != 0) == (inside_before[c] != 0);
        steps[c] = same ? std::min(steps[c] + 1, kMaxDistanceMapSide) : 1;
    }
}

// Squared distances along a row: nearest[q] becomes the minimum of squared[p] + (q - p)^2 over all p, for
// those of one kind; it is 0 for the other, in both. A cell farther away than the largest minimum so far
// decides nothing. `squared` is preceded and followed by `columns` + 1 cells of no influence.
inline void search_row(const std::int32_t* squared, int columns, std::int32_t* nearest) {
    std::int32_t most = 0;
    for (int q = 0; q < columns; ++q) nearest[q] = squared[q], most = std::max(most, squared[q]);
    for (int d = 1; d < columns && d * d < most; d += 2) {  // two at once: fewer passes
        most = 0;
        const std::int32_t near = d * d, far = (d + 1) * (d + 1);
        for (int q = 0; q < columns; ++q) {
            const std::int32_t a = std::min(squared[q - d], squared[q + d]) + near;
            const std::int32_t b = std::min(squared[q - d - 1], squared[q + d + 1]) + far;
            nearest[q] = std::min(nearest[q], std::min(a, b));
            most = std::max(most, nearest[q]);
        }
    }
}

void signed_distances(const std::uint8_t* inside, int columns, int rows, float* distance) {
    constexpr std::int32_t kFar = kMaxDistanceMapSide * kMaxDistanceMapSide;
    const auto row_of = [columns](auto* cells, int r) {
        return cells + static_cast<std::ptrdiff_t>(r) * columns;
    };
    const std::ptrdiff_t margin = columns + 1;
    std::vector<std::int32_t> work(5 * margin, kFar);
    std::int32_t* const steps = work.data();
    for (const bool down : {true, false}) {
        std::fill_n(steps, columns, kMaxDistanceMapSide);
        for (int n = 0; n < rows; ++n) {
            const int r = down ? n : rows - 1 - n;
            if (n > 0) extend(row_of(inside, r), row_of(inside, down ? r - 1 : r + 1), columns, steps);
            float* const row = row_of(distance, r);
            if (down)
                for (int c = 0; c < columns; ++c) row[c] = static_cast<float>(steps[c]);
            else
                for (int c = 0; c < columns; ++c) row[c] = std::min(row[c], static_cast<float>(steps[c]));
        }
    }
    std::int32_t* const squared = steps + 2 * margin;
    std::int32_t* const nearest = squared + 2 * margin;
    for (int r = 0; r < rows; ++r) {
        const std::uint8_t* const kind = row_of(inside, r);
        float* const row = row_of(distance, r);
        for (int c = 0; c < columns; ++c) {
            const auto in_column = static_cast<std::int32_t>(row[c]);
            squared[c] = kind[c] ? in_column * in_column : 0;
            steps[c] = kind[c] ? 0 : in_column * in_column;
        }
        search_row(squared, columns, nearest);
        for (int c = 0; c < columns; ++c)
            if (kind[c]) row[c] = std::sqrt(static_cast<float>(nearest[c])) - 0.5f;
        std::copy_n(steps, columns, squared);
        search_row(squared, columns, nearest);
        for (int c = 0; c < columns; ++c)
            if (!kind[c]) row[c] = 0.5f - std::sqrt(static_cast<float>(nearest[c]));
    }
}

}  // namespace kinevox::kernels::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels {

KINEVOX_EXPORT(signed_distances);

void signed_distances(const std::uint8_t* inside, int columns, int rows, float* distance) {
    if (columns < 1 || rows < 1 || columns > kMaxDistanceMapSide || rows > kMaxDistanceMapSide)
        throw std::invalid_argument("distance map: " + std::to_string(columns) + " x " +
                                    std::to_string(rows) + " cells; between 1 and " +
                                    std::to_string(kMaxDistanceMapSide) + " a side");
    KINEVOX_DISPATCH(signed_distances)(inside, columns, rows, distance);
}

}  // namespace kinevox::kernels
#endif
