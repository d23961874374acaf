// The steps of segmentation on the device, each queued on a stream; kernels/cpu/segmentation.cc explains
// them. Data are stored in cells of 64 pixels as in kernels/cpu/segmentation_model.h; a block of threads
// works on one cell.
#pragma once

#include <cstdint>

#include "kernels/cuda/device.h"
#include "kernels/shared/kde_border.h"
#include "kernels/shared/kde_density.h"
#include "kernels/shared/kde_evidence.h"
#include "kernels/shared/kde_shadow.h"
#include "kernels/shared/kde_update.h"
#include "kernels/types.h"

namespace kinevox::kernels::cuda {

// Rows [y0, y1) of cells [k0, k1).
struct CellRange {
    int y0 = 0, y1 = 0, k0 = 0, k1 = 0;
    __host__ __device__ bool empty() const { return y1 <= y0 || k1 <= k0; }
};

inline constexpr int kPlaneMargin = 8;  // rows above and below the planes of floats; a cell at each side

// Device pointers and sizes; handed to every kernel.
struct SegmentData {
    int width = 0, height = 0, channels = 0, sample_count = 0, cells_per_row = 0;
    std::uint8_t *samples, *scale, *reference, *candidate, *visits;  // as BackgroundModel
    float* log_peak;
    const std::uint8_t* image;       // interleaved, without padding
    std::uint8_t *values, *density;  // of this image, as BackgroundModel's planes
    std::uint8_t *candidates,
        *active;  // per cell, its groups (kde_evidence.h) near unsure pixels and those looked at
    float *weighted_value, *weighted_energy, *factor, *residual, *evidence, *smoothed;
    float *neighbourhood, *product, *energy, *square, *misfit, *voted;  // see kernels/cpu/shadow.h
    const float *log_lit, *log_foreground;
    const float* log_scale;  // cpu::log_scales()
    const std::uint8_t* probability_of;
    std::uint8_t *probability, *sharp, *loose, *zones;  // width bytes a row
    const std::uint8_t* expected;                       // or null
    int* active_box;                                    // y0 y1 k0 k1
    int* colour_counts;
    unsigned long long* sums;  // of `sharp`: pixels, x, y
    int* bounds;               // of `loose`: x0 y0 x1 y1
    std::int8_t* votes;        // per block of kde::kVoteBlock_px, see kde::SceneView
    int* vote_box;             // of the blocks in the subject: x0 y0 x1 y1, number
    int* changed;              // per vote block, pixels that the votes would change
    std::uint8_t* added;       // per vote block, whether they do
    float* support;            // per block of kde::kSupportBlock_px
    int gain_64[3];
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
};

struct Smoothing {
    float w0, w1, w2;  // five taps: w0 w1 w2 w1 w0
};

void queue_density(const Stream& stream, const SegmentData& data, const CellRange& work);
// Density of every `interval`-th row from `phase` on, where `work` did not go.
void queue_density_of_rows(const Stream& stream, const SegmentData& data, const CellRange& work, int phase,
                           int interval);
// Fills data.active and data.active_box, which must hold {height, 0, cells_per_row, 0} before.
void queue_active(const Stream& stream, const SegmentData& data, const CellRange& work);
void queue_evidence(const Stream& stream, const SegmentData& data, const CellRange& box);

// Fills data.votes, and data.vote_box, which must hold {columns, rows, 0, 0, 0} before.
void queue_votes(const Stream& stream, const SegmentData& data, const CellRange& box);

// What the cameras see of the floor; `count` 0: not known.
struct FloorScenes {
    kde::FloorGrid grid;
    Projector camera;
    kde::SceneView others[kde::kMaxFloorViews];
    int count = 0;
};
// Fills data.support, data.changed and data.added and gives doubtful pixels their evidence by the rule of
// shared/kde_shadow.h.
void queue_shadows(const Stream& stream, const SegmentData& data, const CellRange& box,
                   const FloorScenes& floor);
void queue_smoothing(const Stream& stream, const SegmentData& data, const CellRange& box,
                     const Smoothing& smoothing);
// Log odds above which a pixel belongs to a silhouette; evidence_to_step turns nats into 1 / 127.5 of the
// limit.
void queue_decisions(const Stream& stream, const SegmentData& data, const Rect& box, float sharp,
                     float loose);
void queue_colour_counts(const Stream& stream, const SegmentData& data, const Rect& box, float sure_evidence);
// data.zones must be filled for `box` and kde::kBorderRadius around it.
void queue_border(const Stream& stream, const SegmentData& data, const Rect& box, const Rect& limit);
// Adds `sharp` to `loose` and measures both; sums must be 0 and bounds {width, height, 0, 0} before.
void queue_measure(const Stream& stream, const SegmentData& data, const Rect& box);
void queue_update(const Stream& stream, const SegmentData& data, const kde::UpdateParameters& parameters,
                  int phase, int interval, bool tracked);

}  // namespace kinevox::kernels::cuda
