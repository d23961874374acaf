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

struct Window {
    const SegmentData& d;
    const Tile& tile;
    const Word (&mask)[kMaskRows][kMaskCells];

    // Pixels outside the image count neither as set nor as unset.
    __device__ Word outside(int row, int cell) const {
        const int y = tile.y0 - (kMaskRows - kTileRows) / 2 + row,
                  end = d.width - (tile.k - 2 + cell) * kCellPixels;
        if (y < 0 || y >= d.height || end <= 0 || tile.k - 2 + cell < 0) return ~Word{0};
        return end < kCellPixels ? ~Word{0} << end : 0;
    }
    // The pixel `dx` (-2 .. 2) to the right of each pixel; `all`: with those outside.
    __device__ Word shifted(int row, int cell, int dx, bool all) const {
        const auto word = [&](int k) { return mask[row][k] | (all ? outside(row, k) : 0); };
        if (dx == 0) return word(cell);
        return dx > 0 ? word(cell) >> dx | word(cell + 1) << (kCellPixels - dx)
                      : word(cell) << -dx | word(cell - 1) >> (kCellPixels + dx);
    }
    // Whether all, or any, of the pixels within two steps of each pixel are set.
    template <bool kAll>
    __device__ Word diamond(int row, int cell) const {
        Word result = kAll ? ~Word{0} : 0;
        for (int dy = -2; dy <= 2; ++dy) {
            const int half = 2 - (dy < 0 ? -dy : dy);
            for (int dx = -half; dx <= half; ++dx) {
                const Word pixels = shifted(row + dy, cell, dx, kAll);
                result = kAll ? result & pixels : result | pixels;
            }
        }
        return result;
    }
};

// Pixels of the subject whose neighbours two pixels away belong to it, too; not at the image's edge.
__device__ Word inner_pixels(const SegmentData& d, const Window& window, int row, int y, int k) {
    constexpr int kDepth = 2;
    if (y < kDepth || y >= d.height - kDepth) return 0;
    const int x = k * kCellPixels;
    Word edge = x == 0 ? Word{3} : 0;
    for (int lane = d.width - kDepth - x; lane < kCellPixels; ++lane)
        if (lane >= 0) edge |= Word{1} << lane;
    return window.mask[row][2] & window.mask[row - kDepth][2] & window.mask[row + kDepth][2] &
           window.shifted(row, 2, -kDepth, false) & window.shifted(row, 2, kDepth, false) & ~edge;
}

template <int kChannels>
__global__ void __launch_bounds__(kTileThreads) border_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ Word mask[kMaskRows][kMaskCells];
    __shared__ Word inside[kZoneRows][kZoneCells], near[kZoneRows][kZoneCells];
    __shared__ Word inner[kTileRows];
    __shared__ std::uint8_t zones[kZoneRows][kZoneColumns];
    const SegmentData& d = cameras[blockIdx.z];
    const Tile tile(d.work);
    const CellRange box = d.state->box;
    if (tile.k < box.k0 || tile.k >= box.k1 || tile.y0 >= box.y1 || tile.y0 + kTileRows <= box.y0) return;
    const int n = static_cast<int>(threadIdx.x), x = tile.x(), y = tile.y();
    if (n < kMaskRows * kMaskCells) {
        const int from_y = tile.y0 - (kMaskRows - kTileRows) / 2 + n / kMaskCells,
                  from_k = tile.k - 2 + n % kMaskCells;
        mask[n / kMaskCells][n % kMaskCells] =
            box.holds(from_y, from_k) ? d.sharp[d.cell(from_y, from_k)] : 0;
    }
    __syncthreads();
    const Window window{d, tile, mask};
    if (n < kZoneRows * kZoneCells) {
        const int row = n / kZoneCells, cell = n % kZoneCells;
        inside[row][cell] = window.diamond<true>(row + 2, cell + 1);
        near[row][cell] = window.diamond<false>(row + 2, cell + 1);
    }
    if (n >= kTileThreads - kTileRows) {
        const int row = n - (kTileThreads - kTileRows);
        inner[row] = inner_pixels(d, window, row + (kMaskRows - kTileRows) / 2, tile.y0 + row, tile.k);
    }
    __syncthreads();
    const int zone_row = tile.row + kde::kBorderRadius, mask_row = zone_row + kde::kBorderDepth;
    const bool here = box.holds(y, tile.k) && x < d.width;
    const std::size_t cell = here ? d.cell(y, tile.k) : 0;
    if (d.count_colours && here && inner[tile.row] >> tile.lane & 1 &&
        d.smoothed[d.at(y, x)] >= d.sure_evidence)
        atomicAdd(d.colour_counts +
                      kde::histogram_bin<kChannels>(d.values + cell * kChannels * kCellPixels + tile.lane),
                  1);
    const Word border = near[zone_row][1] & ~inside[zone_row][1];
    const bool asked = d.refine_border && here && border >> tile.lane & 1;
    bool set = mask[mask_row][2] >> tile.lane & 1;
    if (__syncthreads_or(asked)) {
        for (int i = n; i < kZoneRows * kZoneColumns; i += kTileThreads) {
            const int row = i / kZoneColumns, cells = i % kZoneColumns / kCellPixels, lane = i % kCellPixels;
            zones[row][i % kZoneColumns] = inside[row][cells] >> lane & 1 ? kde::kZoneInside
                                           : near[row][cells] >> lane & 1 ? kde::kZoneBorder
                                                                          : kde::kZoneOutside;
        }
        __syncthreads();
        if (asked) {
            // So that the pixel (x, y) of the image is found where it lies in the window.
            const std::uint8_t* origin =
                zones[0] - static_cast<std::ptrdiff_t>(tile.y0 - kde::kBorderRadius) * kZoneColumns -
                static_cast<std::ptrdiff_t>(tile.k - 1) * kCellPixels;
            const Rect limit{d.work.k0 * kCellPixels, d.work.y0, min(d.work.k1 * kCellPixels, d.width),
                             d.work.y1};
            const int part = kde::unmix_border_pixel<kChannels>(x, y, kZoneColumns, limit, origin, d.values,
                                                                d.reference, d.cells_per_row, {});
            if (part >= 0) set = part != 0;
        }
    }
    const unsigned pixels = __ballot_sync(0xffffffffu, set);
    if (box.holds(y, tile.k) && tile.lane % 32 == 0)
        reinterpret_cast<unsigned*>(d.refined)[2 * d.cell(y, tile.k) + tile.lane / 32] = pixels;
}

}  // namespace

void queue_border(const Stream& stream, const FrameSet& cameras, int count) {
    if (cameras.channels == 1) {
        border_kernel<1><<<tiles_of(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    } else {
        border_kernel<3><<<tiles_of(cameras, count), kTileThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
