// The subject's colours and its border to half a pixel.
#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

// A tile and what its pixels' windows hold: zones up to kBorderRadius away, the mask kBorderDepth farther.
constexpr int kZoneRows = kTileRows + 2 * kde::kBorderRadius;
constexpr int kMaskRows = kZoneRows + 2 * kde::kBorderDepth;
constexpr int kZoneCells = 3, kMaskCells = 5, kZoneColumns = kZoneCells * kCellPixels;
static_assert(kde::kBorderDepth == 2);

using MaskWindow = Word[kMaskRows][kMaskCells];

// The pixel `dx` (-2 .. 2) to the right of each pixel of a word.
__device__ Word shifted(const MaskWindow& mask, int row, int cell, int dx) {
    const Word word = mask[row][cell];
    if (dx == 0) return word;
    return dx > 0 ? word >> dx | mask[row][cell + 1] << (kCellPixels - dx)
                  : word << -dx | mask[row][cell - 1] >> (kCellPixels + dx);
}

// Whether all, or any, of the pixels within two steps of each pixel are set.
template <bool kAll>
__device__ Word diamond(const MaskWindow& mask, int row, int cell) {
    Word result = mask[row][cell];
#pragma unroll
    for (int dy = -2; dy <= 2; ++dy) {
        const int half = 2 - (dy < 0 ? -dy : dy);
        for (int dx = -half; dx <= half; ++dx) {
            const Word pixels = shifted(mask, row + dy, cell, dx);
            result = kAll ? result & pixels : result | pixels;
        }
    }
    return result;
}

// The pixels of a word that lie outside the image.
__device__ Word outside(const SegmentData& d, int y, int k) {
    const int end = d.width - k * kCellPixels;
    if (y < 0 || y >= d.height || k < 0 || end <= 0) return ~Word{0};
    return end < kCellPixels ? ~Word{0} << end : 0;
}

// Pixels of the subject whose neighbours two pixels away belong to it, too; not at the image's edge.
__device__ Word inner_pixels(const SegmentData& d, const MaskWindow& mask, int row, int y, int k) {
    constexpr int kDepth = 2;
    if (y < kDepth || y >= d.height - kDepth) return 0;
    const int x = k * kCellPixels;
    const int end = d.width - kDepth - x;
    const Word edge = (x == 0 ? Word{3} : 0) | (end <= 0            ? ~Word{0}
                                                : end < kCellPixels ? ~Word{0} << end
                                                                    : 0);
    return mask[row][2] & mask[row - kDepth][2] & mask[row + kDepth][2] & shifted(mask, row, 2, -kDepth) &
           shifted(mask, row, 2, kDepth) & ~edge;
}

using ZoneWindow = std::uint8_t[kZoneRows][kZoneColumns];

// The border pixels of a tile, as threads count them, and what is found: whether each belongs to the subject.
struct Border {
    int count;
    std::uint8_t pixels[kTileThreads];
    std::int8_t parts[kTileThreads];  // as kde::unmix()
};

__device__ int sum_of_eight(int value) {
    for (int step = 4; step > 0; step /= 2) value += __shfl_xor_sync(0xffffffffu, value, step);
    return value;
}

// kde::unmix_border_pixel() of all of them: eight threads share a pixel's window, each has one of its rows.
template <int kChannels>
__device__ void unmix(const SegmentData& d, const Tile& tile, const ZoneWindow& zones, Border& border) {
    constexpr int kThreadsOfPixel = 8, kRows = 2 * kde::kBorderRadius + 1;
    static_assert(kRows <= kThreadsOfPixel);
    // So that the pixel (x, y) of the image is found where it lies in the window.
    const std::uint8_t* origin = zones[0] -
                                 static_cast<std::ptrdiff_t>(tile.y0 - kde::kBorderRadius) * kZoneColumns -
                                 static_cast<std::ptrdiff_t>(tile.k - 1) * kCellPixels;
    const Rect limit{d.work.k0 * kCellPixels, d.work.y0, min(d.work.k1 * kCellPixels, d.width), d.work.y1};
    const int row = static_cast<int>(threadIdx.x) % kThreadsOfPixel;
    for (int first = 0; first < border.count; first += kTileThreads / kThreadsOfPixel) {
        const int n = first + static_cast<int>(threadIdx.x) / kThreadsOfPixel;
        const int pixel = n < border.count ? border.pixels[n] : 0;
        const int x = tile.k * kCellPixels + pixel % kCellPixels, y = tile.y0 + pixel / kCellPixels;
        kde::BorderSums<kChannels> sums;
        if (n < border.count && row < kRows)
            kde::add_row_around<kChannels>(x, y, y - kde::kBorderRadius + row, kZoneColumns, limit, origin,
                                           d.values, d.reference, d.cells_per_row, sums);
        for (int c = 0; c < kChannels; ++c) sums.subject[c] = sum_of_eight(sums.subject[c]);
        sums.subject_weight = sum_of_eight(sums.subject_weight);
        sums.product = sum_of_eight(sums.product);
        sums.energy = sum_of_eight(sums.energy);
        if (n >= border.count || row != 0) continue;
        const long long at = kde::border_offset<kChannels>(x, y, d.cells_per_row);
        border.parts[pixel] =
            static_cast<std::int8_t>(kde::unmix<kChannels>(sums, d.values + at, d.reference + at, {}));
    }
}

template <int kChannels>
__device__ void count_colour(const SegmentData& d, int y, int x) {
    if (d.smoothed[d.at(y, x)] < d.sure_evidence) return;
    const std::uint8_t* value =
        d.values + d.cell(y, x / kCellPixels) * kChannels * kCellPixels + x % kCellPixels;
    atomicAdd(d.colour_counts + kde::histogram_bin<kChannels>(value), 1);
}

template <int kChannels>
__global__ void __launch_bounds__(kTileThreads) border_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ MaskWindow mask, with_outside;
    __shared__ Word inside[kZoneRows][kZoneCells], near[kZoneRows][kZoneCells];
    __shared__ Word inner[kTileRows];
    __shared__ ZoneWindow zones;
    __shared__ Border border;
    const SegmentData& d = cameras[blockIdx.z];
    const CellRange box = d.state->box;
    const Tile tile((box.y0 / kTileRows + static_cast<int>(blockIdx.y)) * kTileRows,
                    box.k0 + static_cast<int>(blockIdx.x));
    if (tile.k >= box.k1 || tile.y0 >= box.y1) return;
    const int n = static_cast<int>(threadIdx.x), x = tile.x(), y = tile.y();
    Word found = 0;
    if (n == 0) border.count = 0;
    if (n < kMaskRows * kMaskCells) {
        const int from_y = tile.y0 - (kMaskRows - kTileRows) / 2 + n / kMaskCells,
                  from_k = tile.k - 2 + n % kMaskCells;
        if (box.holds(from_y, from_k)) found = d.sharp[d.cell(from_y, from_k)];
        mask[n / kMaskCells][n % kMaskCells] = found;
        with_outside[n / kMaskCells][n % kMaskCells] = found | outside(d, from_y, from_k);
    }
    const bool here = box.holds(y, tile.k);
    unsigned* const refined =
        reinterpret_cast<unsigned*>(d.refined) + (here ? 2 * d.cell(y, tile.k) + tile.lane / 32 : 0);
    if (!__syncthreads_or(found != 0)) {  // most tiles
        if (here && tile.lane % 32 == 0) *refined = 0;
        return;
    }
    if (n < kZoneRows * kZoneCells) {
        const int row = n / kZoneCells, cell = n % kZoneCells;
        inside[row][cell] = diamond<true>(with_outside, row + 2, cell + 1);
        near[row][cell] = diamond<false>(mask, row + 2, cell + 1);
    }
    if (n >= kTileThreads - kTileRows) {
        const int row = n - (kTileThreads - kTileRows);
        inner[row] = inner_pixels(d, mask, row + (kMaskRows - kTileRows) / 2, tile.y0 + row, tile.k);
    }
    __syncthreads();
    const int zone_row = tile.row + kde::kBorderRadius;
    if (d.count_colours && here && inner[tile.row] >> tile.lane & 1) count_colour<kChannels>(d, y, x);
    const bool asked =
        d.refine_border && here && x < d.width && (near[zone_row][1] & ~inside[zone_row][1]) >> tile.lane & 1;
    bool set = mask[zone_row + kde::kBorderDepth][2] >> tile.lane & 1;
    if (asked) border.pixels[atomicAdd(&border.count, 1)] = static_cast<std::uint8_t>(n);
    if (__syncthreads_or(asked)) {
        for (int i = n; i < kZoneRows * kZoneColumns; i += kTileThreads) {
            const int row = i / kZoneColumns, cells = i % kZoneColumns / kCellPixels, lane = i % kCellPixels;
            zones[row][i % kZoneColumns] = inside[row][cells] >> lane & 1 ? kde::kZoneInside
                                           : near[row][cells] >> lane & 1 ? kde::kZoneBorder
                                                                          : kde::kZoneOutside;
        }
        __syncthreads();
        unmix<kChannels>(d, tile, zones, border);
        __syncthreads();
        if (asked && border.parts[n] >= 0) set = border.parts[n] != 0;
    }
    const unsigned pixels = __ballot_sync(0xffffffffu, set);
    if (here && tile.lane % 32 == 0) *refined = pixels;
}

}  // namespace

void queue_border(const Stream& stream, const FrameSet& cameras, int count) {
    // As many tiles as the work has, in case that the box is all of it.
    const dim3 tiles(
        max_of(cameras, count, [](const SegmentData& d) { return d.work.columns(); }),
        max_of(cameras, count, [](const SegmentData& d) { return d.work.rows() / kTileRows + 2; }),
        static_cast<unsigned>(count));
    if (cameras.channels == 1) {
        border_kernel<1><<<tiles, kTileThreads, 0, stream.get()>>>(cameras.device);
    } else {
        border_kernel<3><<<tiles, kTileThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
