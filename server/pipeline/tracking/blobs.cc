#include "server/pipeline/tracking/blobs.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <numeric>

namespace kinevox {
namespace {

using kernels::Rect;

// Foreground of one square cell of the image.
struct Cell {
    std::int64_t sharp = 0;                            // pixels
    std::int64_t weight = 0, sum_x = 0, sum_y = 0;     // of its sampled sharp pixels, weighted
    int x0 = 1 << 30, y0 = 1 << 30, x1 = -1, y1 = -1;  // of its loose pixels, half open; x1 < 0: none
};

struct CellGrid {
    Rect area;     // px
    int edge = 8;  // px
    int columns = 0, rows = 0;
    std::vector<Cell> cells;

    Cell& at(int x, int y) {
        return cells[static_cast<std::size_t>((y - area.y0) / edge) * columns + (x - area.x0) / edge];
    }
};

std::uint64_t load_word(const std::uint8_t* bytes, int count) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes, static_cast<std::size_t>(count));
    return word;
}

// Pixels are 0 or 255, so that each byte of a word holds 8 equal bits (little endian: the first pixel is
// lowest).
void count_pixels(const kernels::Silhouettes& s, CellGrid& grid) {
    for (int y = grid.area.y0; y < grid.area.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * s.width;
        for (int x = grid.area.x0; x < grid.area.x1; x += 8) {
            const int count = std::min(8, s.width - x);
            const std::uint64_t loose = load_word(s.loose.data() + row + x, count);
            if (loose == 0) continue;
            Cell& cell = grid.at(x, y);
            cell.x0 = std::min(cell.x0, x + std::countr_zero(loose) / 8);
            cell.x1 = std::max(cell.x1, x + 8 - std::countl_zero(loose) / 8);
            cell.y0 = std::min(cell.y0, y);
            cell.y1 = y + 1;
            cell.sharp += std::popcount(load_word(s.sharp.data() + row + x, count)) / 8;
        }
    }
}

// Distance to the contour by the two passes of the 3-4 chamfer (Borgefors 1986), on every `step`-th pixel.
void weigh_pixels(const kernels::Silhouettes& s, CellGrid& grid) {
    constexpr int kMaxRows = 200;
    const int step = std::max(1, (std::max(grid.area.height(), grid.area.width()) + kMaxRows - 1) / kMaxRows);
    const int width = grid.area.width() / step, height = grid.area.height() / step;
    const int stride = width + 2;  // a border of zeros: pixels beyond the area are outside
    std::vector<int> distance(static_cast<std::size_t>(stride) * (height + 2), 0);
    const auto sample = [&](int n, int first) { return first + n * step + step / 2; };
    for (int y = 0; y < height; ++y) {
        const std::uint8_t* row =
            s.sharp.data() + static_cast<std::size_t>(sample(y, grid.area.y0)) * s.width;
        int* d = distance.data() + static_cast<std::size_t>(y + 1) * stride + 1;
        for (int x = 0; x < width; ++x) {
            if (row[sample(x, grid.area.x0)] == 0) continue;
            const int* above = d + x - stride;
            d[x] = std::min({d[x - 1] + 3, above[0] + 3, above[-1] + 4, above[1] + 4});
        }
    }
    for (int y = height - 1; y >= 0; --y) {
        int* d = distance.data() + static_cast<std::size_t>(y + 1) * stride + 1;
        const int v = sample(y, grid.area.y0);
        for (int x = width - 1; x >= 0; --x) {
            if (d[x] == 0) continue;
            const int* below = d + x + stride;
            d[x] = std::min({d[x], d[x + 1] + 3, below[0] + 3, below[-1] + 4, below[1] + 4});
            const int u = sample(x, grid.area.x0);
            Cell& cell = grid.at(u, v);
            cell.weight += d[x];
            cell.sum_x += std::int64_t{d[x]} * u;
            cell.sum_y += std::int64_t{d[x]} * v;
        }
    }
}

int root_of(std::vector<int>& parent, int n) {
    while (parent[n] != n) n = parent[n] = parent[parent[n]];
    return n;
}

void join(std::vector<int>& parent, int a, int b) {
    a = root_of(parent, a), b = root_of(parent, b);
    parent[std::max(a, b)] = std::min(a, b);
}

Rect united(const Rect& a, const Rect& b) {
    if (a.empty()) return b;
    if (b.empty()) return a;
    return {std::min(a.x0, b.x0), std::min(a.y0, b.y0), std::max(a.x1, b.x1), std::max(a.y1, b.y1)};
}

}  // namespace

std::vector<Blob> find_blobs(const kernels::Silhouettes& s, std::int64_t min_sharp_pixels,
                             std::size_t max_count) {
    const Rect area{std::max(s.bounds.x0, 0) & ~7, std::max(s.bounds.y0, 0), std::min(s.bounds.x1, s.width),
                    std::min(s.bounds.y1, s.height)};
    if (area.empty()) return {};
    CellGrid grid;
    grid.area = area;
    grid.edge = 8 * std::max(1, (s.height + 240) / 480);  // a multiple of the word
    grid.columns = (area.width() + grid.edge - 1) / grid.edge;
    grid.rows = (area.height() + grid.edge - 1) / grid.edge;
    grid.cells.resize(static_cast<std::size_t>(grid.columns) * grid.rows);
    count_pixels(s, grid);
    weigh_pixels(s, grid);
    const std::vector<Cell>& cells = grid.cells;
    const int columns = grid.columns, rows = grid.rows;

    std::vector<int> parent(cells.size());
    std::iota(parent.begin(), parent.end(), 0);
    for (int r = 0; r < rows; ++r)
        for (int c = 0; c < columns; ++c) {
            const int n = r * columns + c;
            if (cells[n].x1 < 0) continue;
            const auto join_if_occupied = [&](int rr, int cc) {
                if (rr < 0 || cc < 0 || cc >= columns || cells[rr * columns + cc].x1 < 0) return;
                join(parent, n, rr * columns + cc);
            };
            join_if_occupied(r, c - 1);
            join_if_occupied(r - 1, c - 1);
            join_if_occupied(r - 1, c);
            join_if_occupied(r - 1, c + 1);
        }

    struct Sums {
        std::int64_t sharp = 0, weight = 0, x = 0, y = 0;
        Rect bounds;
    };
    std::vector<Sums> sums(cells.size());
    for (std::size_t n = 0; n < cells.size(); ++n) {
        if (cells[n].x1 < 0) continue;
        Sums& to = sums[root_of(parent, static_cast<int>(n))];
        to.sharp += cells[n].sharp, to.weight += cells[n].weight;
        to.x += cells[n].sum_x, to.y += cells[n].sum_y;
        to.bounds = united(to.bounds, {cells[n].x0, cells[n].y0, cells[n].x1, cells[n].y1});
    }
    std::vector<Blob> blobs;
    for (const Sums& sum : sums) {
        if (sum.sharp < std::max<std::int64_t>(min_sharp_pixels, 1) || sum.weight == 0) continue;
        const double weight = static_cast<double>(sum.weight);
        blobs.push_back({sum.sharp, weight, static_cast<double>(sum.x) / weight,
                         static_cast<double>(sum.y) / weight, sum.bounds,
                         sum.bounds.x0 <= 0 || sum.bounds.y0 <= 0 || sum.bounds.x1 >= s.width ||
                             sum.bounds.y1 >= s.height});
    }
    std::stable_sort(blobs.begin(), blobs.end(),
                     [](const Blob& a, const Blob& b) { return a.sharp_pixels > b.sharp_pixels; });
    if (blobs.size() > max_count) blobs.resize(max_count);
    return blobs;
}

Blob merged(const std::vector<Blob>& blobs) {
    Blob all;
    for (const Blob& blob : blobs) {
        all.sharp_pixels += blob.sharp_pixels;
        all.weight += blob.weight;
        all.centroid_x += blob.weight * blob.centroid_x;
        all.centroid_y += blob.weight * blob.centroid_y;
        all.bounds = united(all.bounds, blob.bounds);
        all.at_border = all.at_border || blob.at_border;
    }
    all.centroid_x /= all.weight;
    all.centroid_y /= all.weight;
    return all;
}

}  // namespace kinevox
