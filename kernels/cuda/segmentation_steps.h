// The steps of segmentation on the device, each queued on a stream for all cameras of a frame set at once;
// kernels/cpu/segmenter.h explains them. Nothing returns to the host between them: what one step finds
// out for the next (the image's gain, the active box, the lists of cells) stays in CameraState. Data are
// stored in cells of 64 pixels as in kernels/cpu/segmentation_model.h, masks as a bit per pixel.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cuda/device.h"
#include "kernels/shared/kde_border.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/kde_evidence.h"
#include "kernels/shared/kde_faint.h"
#include "kernels/shared/kde_scene.h"
#include "kernels/shared/kde_shadow.h"
#include "kernels/shared/kde_update.h"
#include "kernels/types.h"

namespace kinevox::kernels::cuda {

using Word = unsigned long long;  // of a mask: the pixels of a cell, from the left

// Rows [y0, y1) of cells [k0, k1).
struct CellRange {
    int y0 = 0, y1 = 0, k0 = 0, k1 = 0;
    __host__ __device__ bool empty() const { return y1 <= y0 || k1 <= k0; }
    __host__ __device__ bool holds(int y, int k) const { return y >= y0 && y < y1 && k >= k0 && k < k1; }
    __host__ __device__ int rows() const { return y1 > y0 ? y1 - y0 : 0; }
    __host__ __device__ int columns() const { return k1 > k0 ? k1 - k0 : 0; }
};

inline constexpr int kPlaneMargin = 8;  // rows above and below the planes of floats; a cell at each side
inline constexpr int kTileRows = 4;     // of the tiles, a cell wide, that most steps work on
// As far around an active pixel as it is looked at; each look sees as far again.
inline constexpr int kSurroundings =
    kde::kLightRadius > kde::kPatchRadius ? kde::kLightRadius : kde::kPatchRadius;

// What the device finds out about a frame.
struct CameraState {
    int gain_64[3];                  // cpu::fixed_point_inverse()
    kde::BlockDifference usual;      // of the background's blocks, where faint ones are judged
    float noise_factor;              // kde::noise_factor(), or 1
    CellRange box;                   // around the active cells
    int vote_box[4];                 // of the vote blocks in the subject: x0 y0 x1 y1
    int subject_blocks;              // their number
    int listed;                      // cells in SegmentData::cells
    int near_listed, active_listed;  // tiles in SegmentData::near_tiles and active_tiles
    int changed;                     // pixels that the votes would change
    bool found;                      // anything that may be foreground
};

// What the host gets of a frame beside the masks.
struct CameraResult {
    CellRange box;
    bool found;     // as CameraState
    int bounds[4];  // of `loose`: x0 y0 x1 y1, empty without foreground
    Word sums[3];   // of `sharp`: pixels, x, y
};

// The expected silhouette: only the cells around it, row by row; no words: nothing is expected.
struct ExpectedMask {
    const Word* words;
    CellRange box;
    __host__ __device__ Word at(int y, int k) const {
        return box.holds(y, k) ? words[static_cast<std::size_t>(y - box.y0) * box.columns() + (k - box.k0)]
                               : 0;
    }
};

// Runs of a mask and their components, see components.cu; room for the worst mask.
struct RunLists {
    int* row_begin;  // height + 1
    unsigned* spans;
    int *parent, *area, *flags;
};

// A camera's part of a frame set: device pointers, sizes, and what is asked. In device memory, one after the
// other, for all cameras.
struct SegmentData {
    int width, height, channels, sample_count, cells_per_row;
    std::uint8_t *samples, *scale, *reference, *candidate, *visits;  // as BackgroundModel
    float* log_peak;
    const std::uint8_t* image;          // interleaved, without padding
    std::uint8_t *values, *density;     // of this image, as BackgroundModel's planes
    std::uint8_t *candidates, *active;  // per cell, its groups (kde_evidence.h) near unsure pixels and those
                                        // looked at; `active` holds the last frame's before
    int* group_spans;                   // per row, its first active group, and one more than its last
    int* cells;                         // those that are active, or were in the last frame
    std::uint8_t* near;                 // per tile, whether its smoothed evidence is not neutral
    int *near_tiles, *active_tiles;  // those near an active cell, or not neutral; those with an active cell
    float *weighted_value, *weighted_energy, *factor, *residual, *evidence, *smoothed;
    float *neighbourhood, *product, *energy, *square, *misfit, *voted;  // see kernels/cpu/shadow.h
    const float *log_lit, *log_foreground;
    const float* log_scale;  // cpu::log_scales()
    const std::uint8_t* probability_of;
    ExpectedMask expected;
    Word *sharp, *loose, *refined;  // cells_per_row words a row; valid in the active box
    RunLists runs[2];               // of `loose` and of `sharp`
    CameraState* state;
    kde::SceneView* scene;  // what the other cameras look up
    std::int8_t* votes;     // per block of kde::kVoteBlock_px, see kde::SceneView
    std::uint16_t* faint;   // per row of blocks and cell, its faint blocks as bits (kde_faint.h)
    int *changed, *added;   // per vote block, pixels that the votes would change; whether they do
    float* support;         // per block of kde::kSupportBlock_px
    kde::FloorGrid floor;
    Projector camera;
    int floor_rows;  // of the grid
    bool has_camera;
    // Of this frame. What is looked at lies in `work`; the results hold its cells only, row by row.
    CellRange work;
    bool look;  // the steps from the image to the scene are still to be done
    int others[kde::kMaxFloorViews],
        other_count;  // cameras of the frame set whose view of the floor is asked
    int *colour_counts, colour_bins;
    CameraResult* result;
    Word *result_sharp, *result_loose;
    std::uint8_t* result_probability;
    int phase, interval;  // every `interval`-th row from `phase` on updates the model; 0: none
    bool tracked;
    kde::UpdateParameters update;
    // Options.
    float sharp_from, loose_from;  // log odds above which a pixel belongs to a silhouette
    float smoothing[3];            // five taps: 2 1 0 1 2
    float sure_evidence;           // from which a pixel's colour counts as the subject's
    int min_component_px, max_hole_px;
    float min_component_fraction, max_hole_fraction;
    bool refine_border, count_colours, judge_faint;
    kde::DensityTables tables;
    kde::EvidenceParameters parameters;

    __host__ __device__ int stride() const { return (cells_per_row + 2) * kde::kCellPixels; }
    __host__ __device__ std::size_t plane_size() const {
        return static_cast<std::size_t>(stride()) * (height + 2 * kPlaneMargin);
    }
    // Of a pixel in a plane of floats; y -8 .. height + 7, x -64 .. 64 * (cells_per_row + 1) - 1.
    __host__ __device__ std::size_t at(int y, int x) const {
        return static_cast<std::size_t>(y + kPlaneMargin) * stride() + kde::kCellPixels + x;
    }
    __host__ __device__ int vote_columns() const {
        return (width + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px;
    }
    __host__ __device__ int vote_rows() const {
        return (height + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px;
    }
    __host__ __device__ int support_columns() const {
        return (width + kde::kSupportBlock_px - 1) / kde::kSupportBlock_px;
    }
    __host__ __device__ int support_rows() const {
        return (height + kde::kSupportBlock_px - 1) / kde::kSupportBlock_px;
    }
    __host__ __device__ std::size_t cell(int y, int k) const {
        return static_cast<std::size_t>(y) * cells_per_row + k;
    }
    // Of a row's faint blocks in `faint`.
    __host__ __device__ std::size_t faint_cell(int y, int k) const {
        return cell(y / kde::kFaintBlock_px, k);
    }
    __host__ __device__ bool is_faint(int y, int x) const {
        return judge_faint &&
               faint[faint_cell(y, x / kde::kCellPixels)] >> x % kde::kCellPixels / kde::kFaintBlock_px & 1;
    }
    // Tiles of the image and of a ring around it.
    __host__ __device__ int tile_columns() const { return cells_per_row + 2; }
    __host__ __device__ int tiles() const {
        return tile_columns() * ((height + kTileRows - 1) / kTileRows + 2);
    }
    // Of a cell of `work` in the results.
    __host__ __device__ std::size_t result_cell(int y, int k) const {
        return static_cast<std::size_t>(y - work.y0) * work.columns() + (k - work.k0);
    }
};

// The cameras of a frame set, all with the same number of channels.
struct FrameSet {
    std::span<const SegmentData> host;    // for the sizes of the grids
    const SegmentData* device = nullptr;  // the same
    int channels = 3;
};

// A plane of floats that all have the same value.
void queue_fill(const Stream& stream, float* plane, float value, std::size_t count);

// From the images to each camera's evidence, votes and scene.
void queue_density(const Stream& stream, const FrameSet& cameras);
void queue_faint_blocks(const Stream& stream, const FrameSet& cameras);  // a part of it
void queue_evidence(const Stream& stream, const FrameSet& cameras);

// From the evidence to the masks; the scenes that `others` name must be there. The first `count` cameras.
void queue_shadows(const Stream& stream, const FrameSet& cameras, int count);
void queue_decisions(const Stream& stream, const FrameSet& cameras, int count);
// Removes small components from both masks and fills their holes.
void queue_cleaning(const Stream& stream, const FrameSet& cameras, int count);
// Counts the subject's colours and unmixes the border of `sharp` into `refined`.
void queue_border(const Stream& stream, const FrameSet& cameras, int count);
// Cleans `refined`, adds it to `loose`, measures both and writes the results.
void queue_results(const Stream& stream, const FrameSet& cameras, int count);

// Takes the due rows of the first `count` cameras into their models.
void queue_update(const Stream& stream, const FrameSet& cameras, int count);

// The maximum of `of` over the first `count` cameras; at least 1, so that a grid is never empty.
template <class F>
unsigned max_of(const FrameSet& cameras, int count, F of) {
    std::size_t result = 1;
    for (int n = 0; n < count; ++n) {
        const std::size_t here = static_cast<std::size_t>(of(cameras.host[n]));
        if (here > result) result = here;
    }
    return static_cast<unsigned>(result);
}

constexpr int kMedianThreads = 1024;
#ifdef __CUDACC__
// Whether a cell's pixel belongs to one of the groups.
__device__ inline bool in_group(int groups, int lane) {
    return groups >> lane / kde::kGroupPixels & 1;
}

// The bin that has half of the histogram's total below or in it; each of kMedianThreads threads has a bin.
__device__ inline void find_median(const int* histogram, int* warp_sums, int* median) {
    const int n = static_cast<int>(threadIdx.x), sum = inclusive_sum_of_block(histogram[n], warp_sums);
    const int half = warp_sums[31] / 2;
    if (sum > half && sum - histogram[n] <= half) *median = n;
    __syncthreads();
}

// As split_cell() of the CPU form: gain, rounding, and white that stays white.
__device__ inline int corrected(unsigned value, unsigned gain_64) {
    const unsigned scaled = (((value * gain_64) >> 8) + 32) >> 6;
    return static_cast<int>(value >= 253 ? 255 : scaled < 255 ? scaled : 255);
}

// A tile of kTileRows rows of a cell, for a block of kTileRows * 64 threads. Its rows begin with a row of
// vote blocks.
struct Tile {
    int y0, k, row, lane;
    // The tile of an index below SegmentData::tiles().
    __device__ Tile(const SegmentData& d, int n)
        : Tile((n / d.tile_columns() - 1) * kTileRows, n % d.tile_columns() - 1) {}
    __device__ Tile(int first_row, int cell) : y0(first_row), k(cell) {
        row = static_cast<int>(threadIdx.x) / kde::kCellPixels;
        lane = static_cast<int>(threadIdx.x) % kde::kCellPixels;
    }
    __device__ int y() const { return y0 + row; }
    __device__ int x() const { return k * kde::kCellPixels + lane; }
};
#endif
constexpr int kTileThreads = kTileRows * kde::kCellPixels;

// Blocks that share the list of a camera's tiles; a camera along z.
inline dim3 tile_lists(const FrameSet& cameras, int count) {
    constexpr unsigned kBlocks = 256;  // those of four cameras fill the largest device once
    const unsigned tiles = max_of(cameras, count, [](const SegmentData& d) { return d.tiles(); });
    return dim3(tiles < kBlocks ? tiles : kBlocks, 1, static_cast<unsigned>(count));
}

}  // namespace kinevox::kernels::cuda
