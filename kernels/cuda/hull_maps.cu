// Chessboard distances are separable: along rows first, then along columns. Each thread searches outwards
// from its own place and stops at the first hit, so that near the outline, where it matters, little is read.
#include <algorithm>

#include "kernels/cpu/hull_maps.h"
#include "kernels/cuda/hull_maps.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kFarCells = 127;
constexpr int kMapBlocks = 64;  // of a view; they share its cells and pixels

// Per cell: bit 0 where any of its pixels is foreground, bit 1 where any is background.
__device__ void classify_cell(const MapsOfView& view, int n) {
    const HullMaps& maps = view.maps;
    const int x0 = (n % maps.cells_width + maps.cells_x0) << maps.cell_shift;
    const int y0 = (n / maps.cells_width + maps.cells_y0) << maps.cell_shift;
    const int x1 = min(x0 + (1 << maps.cell_shift), view.mask.box.x1);
    const int y1 = min(y0 + (1 << maps.cell_shift), view.mask.box.y1);
    int kind = 0;
    for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) kind |= view.mask.at(x, y) ? 1 : 2;
    }
    view.kind[n] = static_cast<std::uint8_t>(kind);
}

// Distances along the row to foreground and to background; what lies around the cells is background.
__device__ void cell_row(const MapsOfView& view, int n) {
    const int width = view.maps.cells_width;
    const int x = n % width;
    const std::uint8_t* row = view.kind + (n - x);
    int fore = 0, back = 0;
    for (; fore < kFarCells; ++fore) {
        if (x - fore >= 0 && row[x - fore] & 1) break;
        if (x + fore < width && row[x + fore] & 1) break;
    }
    for (; back < kFarCells; ++back) {
        if (x - back < 0 || x + back >= width) break;
        if ((row[x - back] | row[x + back]) & 2) break;
    }
    view.fore[n] = static_cast<std::uint8_t>(fore);
    view.back[n] = static_cast<std::uint8_t>(back);
}

__device__ void cell_column(const MapsOfView& view, int n) {
    const int width = view.maps.cells_width, height = view.maps.cells_height;
    if (view.bounds.x1 <= view.bounds.x0) {  // nothing in sight
        view.cells[n] = kFarCells;
        return;
    }
    const int x = n % width, y = n / width;
    int fore = kFarCells, back = kFarCells;
    for (int d = 0; d < fore; ++d) {
        if (y - d >= 0) fore = min(fore, max(d, static_cast<int>(view.fore[(y - d) * width + x])));
        if (y + d < height) fore = min(fore, max(d, static_cast<int>(view.fore[(y + d) * width + x])));
    }
    for (int d = 0; d < back; ++d) {
        back = min(back, max(d, y - d >= 0 ? static_cast<int>(view.back[(y - d) * width + x]) : 0));
        back = min(back, max(d, y + d < height ? static_cast<int>(view.back[(y + d) * width + x]) : 0));
    }
    view.cells[n] = static_cast<std::int8_t>(fore - back);
}

// Per row of the bounds, over the width of the miss map: px to the nearest foreground, budget + 1 where it is
// farther.
__device__ void miss_row(const MapsOfView& view, int n) {
    const Rect& bounds = view.bounds;
    const int width = view.maps.miss_width, budget = view.maps.budget_px;
    const int x = n % width + view.maps.miss_x0, y = n / width + bounds.y0;
    int d = 0;
    for (; d <= budget; ++d) {
        if (x - d >= bounds.x0 && x - d < bounds.x1 && view.mask.at(x - d, y)) break;
        if (x + d >= bounds.x0 && x + d < bounds.x1 && view.mask.at(x + d, y)) break;
    }
    view.miss_rows[n] = static_cast<std::uint8_t>(d);
}

__device__ void miss_column(const MapsOfView& view, int n) {
    const HullMaps& maps = view.maps;
    const int width = maps.miss_width, budget = maps.budget_px;
    const int rows = view.bounds.y1 - view.bounds.y0;  // 0 where nothing is in sight
    const int x = n % width, y = n / width + maps.miss_y0 - view.bounds.y0;
    int nearest = budget + 1;
    for (int d = 0; d < nearest; ++d) {
        if (y - d >= 0 && y - d < rows)
            nearest = min(nearest, max(d, static_cast<int>(view.miss_rows[(y - d) * width + x])));
        if (y + d >= 0 && y + d < rows)
            nearest = min(nearest, max(d, static_cast<int>(view.miss_rows[(y + d) * width + x])));
    }
    view.miss[n] = static_cast<std::uint8_t>(maps.miss_of_distance(nearest));
}

__device__ int cells_of(const MapsOfView& view) {
    return view.maps.cells_width * view.maps.cells_height;
}

// The miss map does not need the kinds of cells: its rows are made beside them, its columns beside the cells'
// rows.
__global__ void begin_maps(const VolumeJob* __restrict__ job) {
    const MapsOfView& view = job->map_views[blockIdx.y];
    const int cells = cells_of(view), misses = view.maps.miss_width * (view.bounds.y1 - view.bounds.y0);
    for (int n = thread_index(); n < cells; n += thread_count()) classify_cell(view, n);
    for (int n = thread_index(); n < misses; n += thread_count()) miss_row(view, n);
}

__global__ void map_rows(const VolumeJob* __restrict__ job) {
    const MapsOfView& view = job->map_views[blockIdx.y];
    const int cells = cells_of(view), misses = view.maps.miss_width * view.maps.miss_height;
    for (int n = thread_index(); n < cells; n += thread_count()) cell_row(view, n);
    for (int n = thread_index(); n < misses; n += thread_count()) miss_column(view, n);
}

__global__ void map_columns(const VolumeJob* __restrict__ job) {
    const MapsOfView& view = job->map_views[blockIdx.y];
    const int cells = cells_of(view);
    for (int n = thread_index(); n < cells; n += thread_count()) cell_column(view, n);
}

}  // namespace

MapsOfView frame_maps(const SilhouetteView& view) {
    MapsOfView out;
    out.maps = frame_hull_maps(view.bounds, view.camera, view.miss_budget_permille, view.block_radius_px,
                               out.bounds);
    const HullMaps& maps = out.maps;
    if (out.bounds.empty()) return out;
    const int shift = maps.cell_shift;
    out.mask.box = {maps.cells_x0 << shift, maps.cells_y0 << shift,
                    std::min((maps.cells_x0 + maps.cells_width) << shift, maps.camera.width),
                    std::min((maps.cells_y0 + maps.cells_height) << shift, maps.camera.height)};
    return out;
}

void HullMapMemory::place(std::span<MapsOfView> views) {
    const auto cells_of = [](const MapsOfView& view) {
        return static_cast<std::size_t>(view.maps.cells_width) * view.maps.cells_height;
    };
    const auto misses_of = [](const MapsOfView& view) {
        return static_cast<std::size_t>(view.maps.miss_width) * view.maps.miss_height;
    };
    std::size_t cells = 0, misses = 0;
    for (const MapsOfView& view : views) cells += cells_of(view), misses += misses_of(view);
    for (auto* plane : {&kind_, &fore_, &back_}) plane->resize(cells);
    for (auto* plane : {&miss_rows_, &miss_}) plane->resize(misses);
    cells_.resize(cells);
    std::size_t cell = 0, miss = 0;
    for (MapsOfView& view : views) {
        view.kind = kind_.data() + cell, view.fore = fore_.data() + cell, view.back = back_.data() + cell;
        view.maps.cells = view.cells = cells_.data() + cell;
        view.miss_rows = miss_rows_.data() + miss;
        view.maps.miss = view.miss = miss_.data() + miss;
        cell += cells_of(view), miss += misses_of(view);
    }
}

void queue_maps(const Stream& stream, const VolumeJob* job, int count) {
    if (count == 0) return;
    const dim3 grid(kMapBlocks, static_cast<unsigned>(count));
    begin_maps<<<grid, kThreads, 0, stream.get()>>>(job);
    map_rows<<<grid, kThreads, 0, stream.get()>>>(job);
    map_columns<<<grid, kThreads, 0, stream.get()>>>(job);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
