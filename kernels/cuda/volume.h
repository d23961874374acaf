// From masks to a coloured volume on the device. The host uploads a VolumeJob, queues the steps and waits
// once at the end: all counts that a step needs of another one stay in VolumeState, and lists and images
// have room for more than the last volume needed. Where the room does not suffice, VolumeState says what was
// needed and the host repeats the job (volume_maker.cu).
#pragma once

#include <cstdint>

#include "kernels/cuda/device.h"
#include "kernels/shared/bricks.h"
#include "kernels/shared/colouring.h"
#include "kernels/shared/hull.h"
#include "kernels/shared/visibility.h"

namespace kinevox::kernels::cuda {

// A mask of a bit per pixel, in device memory, and only of a part of the image.
struct BitMask {
    const unsigned long long* words = nullptr;  // the rows of `box`, each of row_words(); null: no mask
    Rect box;                                   // px
    __host__ __device__ int row_words() const { return (box.x1 - box.x0 + 63) / 64; }
    // Of a pixel of the box.
    __host__ __device__ bool at(int x, int y) const {
        const int column = x - box.x0;
        return words[static_cast<std::size_t>(y - box.y0) * row_words() + column / 64] >> column % 64 & 1;
    }
};

// What the kernels know of one silhouette; `maps` holds device pointers.
struct MapsOfView {
    HullMaps maps;
    Rect bounds;   // px, clipped to the image
    BitMask mask;  // whole cells, as far as the image goes
    std::uint8_t *kind = nullptr, *fore = nullptr, *back = nullptr, *miss_rows = nullptr;  // scratch
    std::int8_t* cells = nullptr;
    std::uint8_t* miss = nullptr;
};

struct HullQuestion {
    const HullMaps* maps = nullptr;  // device
    int views = 0;
    int min_views = 0;
};

struct Grid3 {
    int x = 0, y = 0, z = 0;
    __host__ __device__ int count() const { return x * y * z; }
};

struct BrickPosition {
    std::int16_t x, y, z, padding;  // as Brick
};

struct DepthPair {
    float front_m, back_m;  // of the nearest and the farthest surface; kFar_m and 0 where there is none
};

struct CarvingRules {
    float voxel_m = 0;
    bool by_colour = false;  // colours carve
    float min_ray_length_m = 0;
    int support_radius = 0;     // voxels
    int min_support_count = 0;  // 0: no rounding
    float max_difference_std = 0, noise_grey = 0;
};

// One camera of the colouring; see kernels/cpu/visibility.h for the ideas.
struct VolumeView {
    Projector camera;
    const std::uint8_t* image = nullptr;  // rows without padding; null: none
    int channels = 0;
    BitMask mask;  // for the silhouette IoU
    Rect bounds;   // px, where its foreground is counted
    // Per cell; splat() fills one of `splats` while the other one is cleared.
    DepthPair *splats[2] = {}, *depths = nullptr;
    std::uint8_t* means = nullptr;  // B, G, R per cell, of width + 2 by height + 2 cells
    CellColour* colours = nullptr;
};

// What the device finds out of a view.
struct ViewState {
    int shift;          // a cell is 2^shift px wide and high
    Rect cells;         // the part of the image that is looked at, in cells
    int width, height;  // of `cells`
    int nearest[2];     // bits of the depth of the nearest voxel in each of the splats, m; kFar_m: none
    int radius;         // of a voxel's splat in `depths`, cells
    int padding;
    unsigned long long counts[3];  // px: mask, projection, both
};

// How much the device's lists and images can hold.
struct VolumeRoom {
    int bricks = 0;
    int cells = 0;   // of a view
    int voxels = 0;  // of the surface
};

inline constexpr int kMaxRounds = 8;  // of carving, between two waits; even, see queue_rounds()

struct VolumeState {
    int bricks;  // in the list; those without voxels stay, so that indices never change
    int voxels;  // of the surface
    VolumeRoom needed;
    int padding;
    unsigned long long carved_by_sharp, filled;  // voxels
    // By each round, behind that of the round before; a round that follows on 0 has nothing to do.
    unsigned long long carved[kMaxRounds + 1];
};

struct VolumeJob {
    Lattice lattice;
    Grid3 grid, supers;  // the lattice in bricks, and in blocks of kSuperEdge^3 bricks
    VolumeRoom room;
    const MapsOfView* map_views = nullptr;  // the hull's, then those of the sharp silhouettes
    HullQuestion hull, sharp;
    BlockState *super_states = nullptr, *states = nullptr;  // of `supers`, of `grid`; x fastest
    int* group_places = nullptr;   // per kGroup entries of `states`, bricks before them
    const Brick* given = nullptr;  // bricks from the host instead of a hull
    BrickPosition* positions = nullptr;
    std::uint64_t* occupancy[2] = {};  // kBrickEdge words a brick; a step reads one and writes the other one
    std::uint8_t* changed[2] = {};     // per brick, whether a round took a voxel from it; in turns
    int* index = nullptr;              // of the brick at a place of the lattice, see at(); -1: none
    int* surface = nullptr;            // voxels of the surface: per brick, then of those before it
    CarvingRules rules;
    const VolumeView* views = nullptr;
    int view_count = 0;
    // The download begins with these three.
    VolumeState* state = nullptr;
    ViewState* view_states = nullptr;
    Brick* out = nullptr;  // and the colours behind it

    // A rim of one brick lies around the lattice; each coordinate -1 .. size.
    __host__ __device__ int at(int x, int y, int z) const {
        return ((z + 1) * (grid.y + 2) + (y + 1)) * (grid.x + 2) + (x + 1);
    }
    __host__ __device__ int index_size() const { return (grid.x + 2) * (grid.y + 2) * (grid.z + 2); }
};

inline constexpr int kSuperEdge = 4;  // bricks
inline constexpr int kGroup = 16;     // states, read at once

// Sizes of grids: none depends on what only the device knows.
struct VolumeBlocks {
    unsigned bricks = 1;  // blocks that share the list of bricks
    unsigned cells = 1;   // blocks that share the cells of a view
};

// The maps of `count` silhouettes from VolumeJob::map_views.
void queue_maps(const Stream& stream, const VolumeJob* job, int count);

// The hull's bricks into occupancy[0].
void queue_hull(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks);
// The host's bricks into occupancy[0].
void queue_given(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks);
// Clears in occupancy[now] what is outside of the sharp silhouettes.
void queue_sharp(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now);
// Fills voxels that are surrounded, as HoleFiller, from occupancy[now] into the other one. `counts`: whether
// VolumeState::filled does.
void queue_filling(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now,
                   int radius, int min_lines, bool counts);

// The part of each view that the volume covers, and the colours of its cells.
void queue_views(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now);
// `rounds` of carving, at most kMaxRounds, and the depths after them. Occupancy[now + rounds] is then the
// last one. `continued`: more rounds after kMaxRounds others; `look`: how often was looked before.
void queue_rounds(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now,
                  int rounds, bool continued, int look);
// Colours, bricks and counts of pixels for the host.
void queue_results(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views,
                   int now);
// Bricks alone.
void queue_bricks(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int now);

// The steps of queue_rounds() and queue_results() that look at views.
void queue_look(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views, int now,
                int round, int look);
void queue_iou(const Stream& stream, const VolumeJob* job, const VolumeBlocks& blocks, int views);

}  // namespace kinevox::kernels::cuda
