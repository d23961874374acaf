// Chessboard distances are separable: along rows first, then along columns. Each thread searches outwards
// from its own place and stops at the first hit, so that near the outline, where it matters, little is read.
#include <algorithm>
#include <cstring>

#include "kernels/cpu/hull_maps.h"
#include "kernels/cuda/hull_maps.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr int kFarCells = 127;

__device__ bool is_set(const MapsOfView& view, int x, int y) {
    const Rect& box = view.mask_box;
    return view.mask[static_cast<std::size_t>(y - box.y0) * (box.x1 - box.x0) + (x - box.x0)] != 0;
}

// Per cell: bit 0 where any of its pixels is foreground, bit 1 where any is background.
__global__ void classify_cells(const MapsOfView* views) {
    const MapsOfView& view = views[blockIdx.y];
    const HullMaps& maps = view.maps;
    const int n = thread_index();
    if (n >= maps.cells_width * maps.cells_height) return;
    const int x0 = (n % maps.cells_width + maps.cells_x0) << maps.cell_shift;
    const int y0 = (n / maps.cells_width + maps.cells_y0) << maps.cell_shift;
    const int x1 = min(x0 + (1 << maps.cell_shift), view.mask_box.x1);
    const int y1 = min(y0 + (1 << maps.cell_shift), view.mask_box.y1);
    int kind = 0;
    for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) kind |= is_set(view, x, y) ? 1 : 2;
    }
    view.kind[n] = static_cast<std::uint8_t>(kind);
}

// Distances along the row to foreground and to background; what lies around the cells is background.
__global__ void cell_rows(const MapsOfView* views) {
    const MapsOfView& view = views[blockIdx.y];
    const int width = view.maps.cells_width, n = thread_index();
    if (n >= width * view.maps.cells_height) return;
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

__global__ void cell_columns(const MapsOfView* views) {
    const MapsOfView& view = views[blockIdx.y];
    const int width = view.maps.cells_width, height = view.maps.cells_height, n = thread_index();
    if (n >= width * height) return;
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
// farther than the budget.
__global__ void miss_rows(const MapsOfView* views) {
    const MapsOfView& view = views[blockIdx.y];
    const Rect& bounds = view.bounds;
    const int width = view.maps.miss_width, budget = view.maps.budget_px, n = thread_index();
    if (n >= width * (bounds.y1 - bounds.y0)) return;
    const int x = n % width + view.maps.miss_x0, y = n / width + bounds.y0;
    int d = 0;
    for (; d <= budget; ++d) {
        if (x - d >= bounds.x0 && x - d < bounds.x1 && is_set(view, x - d, y)) break;
        if (x + d >= bounds.x0 && x + d < bounds.x1 && is_set(view, x + d, y)) break;
    }
    view.miss_rows[n] = static_cast<std::uint8_t>(d);
}

__global__ void miss_columns(const MapsOfView* views) {
    const MapsOfView& view = views[blockIdx.y];
    const HullMaps& maps = view.maps;
    const int width = maps.miss_width, budget = maps.budget_px, n = thread_index();
    if (n >= width * maps.miss_height) return;
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

}  // namespace

const HullMaps* HullMapMaker::make(const Stream& stream, std::span<const SilhouetteView> views,
                                   float miss_budget_permille) {
    const int count = static_cast<int>(views.size());
    views_.resize(count);
    maps_.resize(count);
    std::size_t mask_bytes = 0, cells = 0, misses = 0, max_cells = 0, max_misses = 0;
    for (int n = 0; n < count; ++n) {
        MapsOfView& view = views_[n];
        view = {};
        view.maps = frame_hull_maps(views[n].bounds, views[n].camera, miss_budget_permille,
                                    views[n].block_radius_px, view.bounds);
        const HullMaps& maps = view.maps;
        if (!view.bounds.empty()) {  // whole cells, as far as the image goes
            const int shift = maps.cell_shift;
            view.mask_box = {maps.cells_x0 << shift, maps.cells_y0 << shift,
                             std::min((maps.cells_x0 + maps.cells_width) << shift, maps.camera.width),
                             std::min((maps.cells_y0 + maps.cells_height) << shift, maps.camera.height)};
        }
        const auto cells_here = static_cast<std::size_t>(maps.cells_width) * maps.cells_height;
        const auto misses_here = static_cast<std::size_t>(maps.miss_width) * maps.miss_height;
        mask_bytes += static_cast<std::size_t>(view.mask_box.width()) * view.mask_box.height();
        cells += cells_here, misses += misses_here;
        max_cells = std::max(max_cells, cells_here), max_misses = std::max(max_misses, misses_here);
    }
    masks_.resize(mask_bytes);
    device_masks_.resize(mask_bytes);
    for (auto* plane : {&kind_, &fore_, &back_}) plane->resize(cells);
    for (auto* plane : {&miss_rows_, &miss_}) plane->resize(misses);
    cells_.resize(cells);
    std::size_t mask_at = 0, cell_at = 0, miss_at = 0;
    for (int n = 0; n < count; ++n) {
        MapsOfView& view = views_[n];
        const Rect& box = view.mask_box;
        view.mask = device_masks_.data() + mask_at;
        for (int y = box.y0; y < box.y1; ++y, mask_at += box.width()) {
            std::memcpy(masks_.data() + mask_at,
                        views[n].mask + static_cast<std::size_t>(y) * view.maps.camera.width + box.x0,
                        box.width());
        }
        view.kind = kind_.data() + cell_at, view.fore = fore_.data() + cell_at,
        view.back = back_.data() + cell_at;
        view.cells = cells_.data() + cell_at;
        view.miss_rows = miss_rows_.data() + miss_at, view.miss = miss_.data() + miss_at;
        view.maps.cells = view.cells, view.maps.miss = view.miss;
        cell_at += static_cast<std::size_t>(view.maps.cells_width) * view.maps.cells_height;
        miss_at += static_cast<std::size_t>(view.maps.miss_width) * view.maps.miss_height;
        maps_[n] = view.maps;
    }
    upload(stream, device_masks_, masks_);
    upload(stream, device_views_, views_);
    upload(stream, device_maps_, maps_);
    const MapsOfView* device = device_views_.data();
    classify_cells<<<blocks(max_cells, count), kThreads, 0, stream.get()>>>(device);
    cell_rows<<<blocks(max_cells, count), kThreads, 0, stream.get()>>>(device);
    cell_columns<<<blocks(max_cells, count), kThreads, 0, stream.get()>>>(device);
    miss_rows<<<blocks(max_misses, count), kThreads, 0, stream.get()>>>(device);
    miss_columns<<<blocks(max_misses, count), kThreads, 0, stream.get()>>>(device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
    return device_maps_.data();
}

}  // namespace kinevox::kernels::cuda
