// Components by union-find on pixels: each tree's root is its lowest pixel, whatever the order of the
// threads.
#include "kernels/cuda/components.h"
#include "kernels/shared/kde_border.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kTouchesBorder = 1, kTouchesSeed = 2;

struct Area {
    Rect box;
    int width = 0;  // of the box

    __device__ bool pixel(int n, int& x, int& y) const {
        x = box.x0 + n % width, y = box.y0 + n / width;
        return y < box.y1;
    }
};

// Halves the path on its way, so that the next one is shorter.
__device__ int root_of(int* labels, int n) {
    const volatile int* now = labels;  // other threads lower labels meanwhile
    for (int parent = now[n]; parent != n; parent = now[n]) {
        const int above = now[parent];
        if (above == parent) return parent;
        atomicMin(labels + n, above);
        n = above;
    }
    return n;
}

__device__ void unite(int* labels, int a, int b) {
    for (;;) {
        a = root_of(labels, a);
        b = root_of(labels, b);
        if (a == b) return;
        const int high = a > b ? a : b, low = a > b ? b : a;
        const int before = atomicMin(labels + high, low);
        if (before == high) return;
        a = before, b = low;  // another thread was faster: `high` is now attached to `before`
    }
}

__device__ bool is_set(const std::uint8_t* mask, int mask_width, int x, int y) {
    return mask[static_cast<std::size_t>(y) * mask_width + x] != 0;
}

constexpr unsigned kAllLanes = 0xffffffffu;

__device__ int highest_bit(unsigned bits) {
    for (int step = 1; step < 32; step *= 2) bits |= bits >> step;
    return __popc(bits) - 1;
}

// Pieces of runs in the warp's 32 pixels: bits of the pixels that are searched, and of each piece's first.
struct Pieces {
    unsigned pixels, firsts;
};
__device__ Pieces pieces_of(bool searched, bool starts_row) {
    const unsigned pixels = __ballot_sync(kAllLanes, searched);
    const unsigned rows = __ballot_sync(kAllLanes, starts_row);
    return {pixels, pixels & (~(pixels << 1) | rows)};
}

// The label of a searched pixel is a pixel's index in the box: at the start of the first of its piece.
__global__ void start_labels(const std::uint8_t* mask, int mask_width, Area area, bool set, int* labels,
                             int* areas, int* flags) {
    const int n = thread_index(), lane = static_cast<int>(threadIdx.x % 32);
    int x, y;
    const bool inside = area.pixel(n, x, y);
    const bool searched = inside && is_set(mask, mask_width, x, y) == set;
    const Pieces pieces = pieces_of(searched, inside && x == area.box.x0);
    if (!inside) return;
    if (searched) labels[n] = n - lane + highest_bit(pieces.firsts & (kAllLanes >> (31 - lane)));
    areas[n] = flags[n] = 0;
}

// Joins pieces: within a row where the warps meet, and with those of the row above, once per pair.
__global__ void join_neighbours(const std::uint8_t* mask, int mask_width, Area area, bool set, bool eight,
                                int* labels) {
    const int n = thread_index();
    int x, y;
    if (!area.pixel(n, x, y)) return;
    const auto searched = [&](int dx, int dy) {
        return x + dx >= area.box.x0 && x + dx < area.box.x1 && y + dy >= area.box.y0 &&
               is_set(mask, mask_width, x + dx, y + dy) == set;
    };
    if (!searched(0, 0)) return;
    const bool left = searched(-1, 0), up = searched(0, -1), up_left = searched(-1, -1);
    if (left && n % 32 == 0) unite(labels, n, n - 1);
    if (up) {
        if (!left || !up_left) unite(labels, n, n - area.width);
    } else if (eight) {
        if (up_left && !left) unite(labels, n, n - area.width - 1);
        if (searched(1, -1) && !searched(1, 0)) unite(labels, n, n - area.width + 1);
    }
}

__global__ void measure_components(const std::uint8_t* mask, int mask_width, Area area, bool set,
                                   const std::uint8_t* seed, int* labels, int* roots, int* areas,
                                   int* flags) {
    const int n = thread_index(), lane = static_cast<int>(threadIdx.x % 32);
    int x, y;
    const bool inside = area.pixel(n, x, y);
    const bool searched = inside && is_set(mask, mask_width, x, y) == set;
    const Rect& box = area.box;
    const Pieces pieces = pieces_of(searched, inside && x == box.x0);
    const unsigned at_border = __ballot_sync(
        kAllLanes, searched && (x == box.x0 || y == box.y0 || x + 1 == box.x1 || y + 1 == box.y1));
    const unsigned seeded = __ballot_sync(kAllLanes, searched && (!seed || is_set(seed, mask_width, x, y)));
    if (!inside) return;
    if (!searched) {
        roots[n] = -1;
        return;
    }
    const int root = root_of(labels, n);
    roots[n] = root;
    if (!(pieces.firsts >> lane & 1)) return;
    // The piece's pixels count at once.
    const unsigned from = kAllLanes << lane, ends = (~pieces.pixels | pieces.firsts) & (from << 1);
    const unsigned piece = ends ? ((ends & (0 - ends)) - 1) & from : from;
    atomicAdd(areas + root, __popc(piece));
    const int flag = (piece & at_border ? kTouchesBorder : 0) | (piece & seeded ? kTouchesSeed : 0);
    if (flag) atomicOr(flags + root, flag);
}

__global__ void find_largest(Area area, const int* areas, const int* flags, int* largest) {
    const int n = thread_index();
    int x, y;
    if (area.pixel(n, x, y) && areas[n] > 0 && flags[n] & kTouchesSeed) atomicMax(largest, areas[n]);
}

__global__ void clear_islands(std::uint8_t* mask, int mask_width, Area area, const int* roots,
                              const int* areas, const int* flags, const int* largest, int min_area,
                              float min_fraction) {
    const int n = thread_index();
    int x, y;
    if (!area.pixel(n, x, y) || roots[n] < 0) return;
    const double part = static_cast<double>(min_fraction) * static_cast<double>(*largest);
    const double bound = part > min_area ? part : static_cast<double>(min_area);
    const int root = roots[n];
    if (!(flags[root] & kTouchesSeed) || areas[root] < bound)
        mask[static_cast<std::size_t>(y) * mask_width + x] = 0;
}

__global__ void set_holes(std::uint8_t* mask, int mask_width, Area area, const int* roots, const int* areas,
                          const int* flags, const int* largest, int max_area, float max_fraction) {
    const int n = thread_index();
    int x, y;
    if (!area.pixel(n, x, y) || roots[n] < 0) return;
    const int root = roots[n];
    const int part = static_cast<int>(max_fraction * static_cast<float>(*largest));
    if (areas[root] < (part > max_area ? part : max_area) && !(flags[root] & kTouchesBorder)) {
        mask[static_cast<std::size_t>(y) * mask_width + x] = 255;
    }
}

__global__ void zones_kernel(const std::uint8_t* sharp, int width, int height, Area area,
                             std::uint8_t* zones) {
    const int n = thread_index();
    int x, y;
    if (!area.pixel(n, x, y)) return;
    constexpr int kDepth = kde::kBorderDepth;
    bool all = true, any = false;
    for (int dy = -kDepth; dy <= kDepth; ++dy) {
        const int half_width = kDepth - (dy < 0 ? -dy : dy);
        for (int dx = -half_width; dx <= half_width; ++dx) {
            if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height) continue;
            const bool is = sharp[static_cast<std::size_t>(y + dy) * width + x + dx] != 0;
            all = all && is;
            any = any || is;
        }
    }
    zones[static_cast<std::size_t>(y) * width + x] = all   ? kde::kZoneInside
                                                     : any ? kde::kZoneBorder
                                                           : kde::kZoneOutside;
}

}  // namespace

void MaskCleaner::find(const Stream& stream, const std::uint8_t* mask, int width, const Rect& box, bool set,
                       bool eight, const std::uint8_t* seed) {
    const Area area{box, box.width()};
    const std::size_t pixels = static_cast<std::size_t>(box.width()) * box.height();
    labels_.resize(2 * pixels);  // labels, then roots
    areas_.resize(pixels);
    flags_.resize(pixels);
    start_labels<<<blocks(pixels), kThreads, 0, stream.get()>>>(mask, width, area, set, labels_.data(),
                                                                areas_.data(), flags_.data());
    join_neighbours<<<blocks(pixels), kThreads, 0, stream.get()>>>(mask, width, area, set, eight,
                                                                   labels_.data());
    measure_components<<<blocks(pixels), kThreads, 0, stream.get()>>>(
        mask, width, area, set, seed, labels_.data(), labels_.data() + pixels, areas_.data(), flags_.data());
}

void MaskCleaner::remove_small_components(const Stream& stream, std::uint8_t* mask, int width,
                                          const Rect& box, int min_area, float min_fraction,
                                          const std::uint8_t* seed) {
    find(stream, mask, width, box, true, true, seed);
    const Area area{box, box.width()};
    const std::size_t pixels = areas_.size();
    largest_.resize(1);
    fill_bytes(stream, largest_.data(), 0, 1);
    find_largest<<<blocks(pixels), kThreads, 0, stream.get()>>>(area, areas_.data(), flags_.data(),
                                                                largest_.data());
    clear_islands<<<blocks(pixels), kThreads, 0, stream.get()>>>(mask, width, area, labels_.data() + pixels,
                                                                 areas_.data(), flags_.data(),
                                                                 largest_.data(), min_area, min_fraction);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void MaskCleaner::fill_holes(const Stream& stream, std::uint8_t* mask, int width, const Rect& box,
                             int max_area, float max_fraction) {
    find(stream, mask, width, box, false, false, nullptr);
    const std::size_t pixels = areas_.size();
    set_holes<<<blocks(pixels), kThreads, 0, stream.get()>>>(
        mask, width, {box, box.width()}, labels_.data() + pixels, areas_.data(), flags_.data(),
        largest_.data(), max_area, max_fraction);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void find_zones(const Stream& stream, const std::uint8_t* sharp, int width, int height, const Rect& box,
                std::uint8_t* zones) {
    const std::size_t pixels = static_cast<std::size_t>(box.width()) * box.height();
    zones_kernel<<<blocks(pixels), kThreads, 0, stream.get()>>>(sharp, width, height, {box, box.width()},
                                                                zones);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
