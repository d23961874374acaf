#include <algorithm>
#include <cstring>
#include <limits>

#include "kernels/cuda/views.h"

namespace kinevox::kernels::cuda {
namespace {

constexpr double kDepthUnit = 1 << 20;  // depths are summed as whole numbers, so that their order never shows

// A thread a brick, a row of blocks a view. boxes: x0 y0 x1 y1 in px; sums: depths, bricks.
__global__ void frame_bricks(const ViewOnDevice* views, const Brick* bricks, int count, Lattice lattice,
                             int* boxes, unsigned long long* sums) {
    const int n = thread_index(), view = blockIdx.y;
    if (n >= count) return;
    const Brick& brick = bricks[n];
    std::uint64_t any = 0;
    for (int k = 0; k < kBrickEdge; ++k) any |= brick.occupancy[k];
    if (any == 0) return;
    const float edge = kBrickEdge * lattice.voxel_m;
    const Projector& c = views[view].camera;
    Rect px{c.width, c.height, 0, 0};
    float depth_m;
    const bool bounded = frame_brick(c, lattice.origin[0] + (brick.x + 0.5f) * edge,
                                     lattice.origin[1] + (brick.y + 0.5f) * edge,
                                     lattice.origin[2] + (brick.z + 0.5f) * edge, edge, px, depth_m);
    atomicMin(boxes + 4 * view, px.x0);
    atomicMin(boxes + 4 * view + 1, px.y0);
    atomicMax(boxes + 4 * view + 2, px.x1);
    atomicMax(boxes + 4 * view + 3, px.y1);
    if (!bounded) return;
    atomicAdd(sums + 2 * view, static_cast<unsigned long long>(static_cast<double>(depth_m) * kDepthUnit));
    atomicAdd(sums + 2 * view + 1, 1ull);
}

// Mean colour of each cell and of a rim of one; beyond the image the rim repeats its border.
__global__ void cell_means(const ViewOnDevice* views) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index(), columns = view.width + 2;
    if (!view.image || view.width == 0 || n >= columns * (view.height + 2)) return;
    const int last_column = (view.camera.width - 1) >> view.shift,
              last_row = (view.camera.height - 1) >> view.shift;
    const int column = min(max(view.cells.x0 + n % columns - 1, 0), last_column);
    const int row = min(max(view.cells.y0 + n / columns - 1, 0), last_row);
    const Rect& box = view.image_box;
    const int x0 = column << view.shift, x1 = min(x0 + (1 << view.shift), view.camera.width);
    const int y0 = row << view.shift, y1 = min(y0 + (1 << view.shift), view.camera.height);
    unsigned sum[3] = {};
    for (int y = y0; y < y1; ++y) {
        for (int x = x0; x < x1; ++x) {
            const std::uint8_t* pixel =
                view.image +
                (static_cast<std::size_t>(y - box.y0) * (box.x1 - box.x0) + (x - box.x0)) * view.channels;
            for (int c = 0; c < 3; ++c) sum[c] += pixel[view.channels == 3 ? c : 0];
        }
    }
    const unsigned count = static_cast<unsigned>((x1 - x0) * (y1 - y0));
    for (int c = 0; c < 3; ++c)
        view.means[3 * n + c] = static_cast<std::uint8_t>((sum[c] + count / 2) / count);
}

// Mean and std_grey over 3 x 3 cells.
__global__ void cell_colours(const ViewOnDevice* views, float max_difference_std, float noise_grey) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index();
    if (n >= view.width * view.height) return;
    CellColour out;
    if (view.image) {
        const int columns = view.width + 2, corner = n / view.width * columns + n % view.width;
        for (int c = 0; c < 3; ++c) {
            float sum = 0, square = 0;  // whole numbers below 2^24: exact in any order
            for (int dy = 0; dy < 3; ++dy) {
                for (int dx = 0; dx < 3; ++dx) {
                    const float value = view.means[3 * (corner + dy * columns + dx) + c];
                    sum += value;
                    square += value * value;
                }
            }
            const float mean = sum * (1 / 9.f), variance = square * (1 / 9.f) - mean * mean;
            out.mean[c] = static_cast<std::uint8_t>(mean + 0.5f);
            const auto std_grey = static_cast<std::uint8_t>(sqrtf(variance > 0 ? variance : 0.f) + 0.5f);
            out.limit[c] = colour_limit(std_grey, max_difference_std, noise_grey);
        }
        out.filled = 1;
    }
    view.colours[n] = out;
}

__global__ void clear_depth(const ViewOnDevice* views) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index();
    if (n == 0) *view.nearest = __float_as_int(kFar_m);
    if (n >= view.width * view.height) return;
    view.front_m[n] = kFar_m;
    view.back_m[n] = 0;
}

// A thread a surface voxel. Depths are positive, so that their bits are ordered as they are.
__global__ void splat(const ViewOnDevice* views, Lattice lattice, SurfaceList surface, VoxelCells out) {
    const int n = thread_index();
    const ViewOnDevice& view = views[blockIdx.y];
    int nearest = __float_as_int(kFar_m);
    if (n < surface.count) {
        const SurfaceVoxel& at = surface.voxels[n];
        const float voxel = lattice.voxel_m;
        const Projector& c = view.camera;
        const CameraPoint p =
            to_camera(c, lattice.origin[0] + 0.5f * voxel + voxel * static_cast<float>(at.x),
                      lattice.origin[1] + 0.5f * voxel + voxel * static_cast<float>(at.y),
                      lattice.origin[2] + 0.5f * voxel + voxel * static_cast<float>(at.z));
        float u, v;
        VoxelCell cell;
        cell.depth_m = p.z;
        if (to_pixel(c, p, u, v)) {
            const int column = (to_index(u) >> view.shift) - view.cells.x0;
            const int row = (to_index(v) >> view.shift) - view.cells.y0;
            if (column >= 0 && row >= 0 && column < view.width && row < view.height) {
                cell.cell = row * view.width + column;
                nearest = __float_as_int(p.z);
                atomicMin(reinterpret_cast<int*>(view.front_m + cell.cell), nearest);
                atomicMax(reinterpret_cast<int*>(view.back_m + cell.cell), nearest);
            }
        }
        out.at(blockIdx.y, n) = cell;
    }
    for (int step = 16; step > 0; step /= 2)
        nearest = min(nearest, __shfl_xor_sync(0xffffffffu, nearest, step));
    if ((threadIdx.x & 31) == 0) atomicMin(view.nearest, nearest);
}

__device__ int splat_radius_of(const ViewOnDevice& view, float voxel_m) {
    return splat_radius(view.camera, view.shift, __int_as_float(*view.nearest), voxel_m);
}

// Each cell takes the nearest front and the farthest back of the cells around it: along rows, then along
// columns.
__global__ void widen_rows(const ViewOnDevice* views, float voxel_m) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index();
    if (n >= view.width * view.height) return;
    const int radius = splat_radius_of(view, voxel_m), x = n % view.width, row = n - x;
    float front = kFar_m, back = 0;
    for (int near = max(x - radius, 0); near <= min(x + radius, view.width - 1); ++near) {
        front = fminf(front, view.front_m[row + near]);
        back = fmaxf(back, view.back_m[row + near]);
    }
    view.front_scratch[n] = front;
    view.back_scratch[n] = back;
}

__global__ void widen_columns(const ViewOnDevice* views, float voxel_m) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index();
    if (n >= view.width * view.height) return;
    const int radius = splat_radius_of(view, voxel_m), x = n % view.width, y = n / view.width;
    float front = kFar_m, back = 0;
    for (int near = max(y - radius, 0); near <= min(y + radius, view.height - 1); ++near) {
        front = fminf(front, view.front_scratch[near * view.width + x]);
        back = fmaxf(back, view.back_scratch[near * view.width + x]);
    }
    view.front_m[n] = front;
    view.back_m[n] = back;
}

// counts[0]: foreground of the mask in its box. A thread a pixel of the image.
__global__ void count_mask(const ViewOnDevice* views) {
    const ViewOnDevice& view = views[blockIdx.y];
    const int n = thread_index(), x = n % view.camera.width, y = n / view.camera.width;
    const Rect& box = view.mask_box;
    const bool set = view.mask && y < view.camera.height && x >= box.x0 && x < box.x1 && y >= box.y0 &&
                     y < box.y1 && view.mask[n] != 0;
    const int here = __syncthreads_count(set);
    if (threadIdx.x == 0 && here > 0) atomicAdd(view.counts, static_cast<unsigned long long>(here));
}

// counts[1] and [2]: the volume's projection, and what of it is in the mask. The splats made the projection
// wider by `radius` cells; a cell counts only if all within that radius are covered.
__global__ void count_projection(const ViewOnDevice* views, float voxel_m) {
    __shared__ unsigned covered, shared_px;
    const ViewOnDevice& view = views[blockIdx.y];
    if (threadIdx.x == 0) covered = shared_px = 0;
    __syncthreads();
    const int n = thread_index();
    if (view.mask && n < view.width * view.height) {
        const int radius = splat_radius_of(view, voxel_m), x = n % view.width, y = n / view.width;
        bool inside = true;
        for (int cy = max(y - radius, 0); inside && cy <= min(y + radius, view.height - 1); ++cy) {
            for (int cx = max(x - radius, 0); inside && cx <= min(x + radius, view.width - 1); ++cx) {
                inside = view.front_m[cy * view.width + cx] < kFar_m;
            }
        }
        if (inside) {
            const int x0 = (x + view.cells.x0) << view.shift, y0 = (y + view.cells.y0) << view.shift;
            const int x1 = min(x0 + (1 << view.shift), view.camera.width);
            const int y1 = min(y0 + (1 << view.shift), view.camera.height);
            unsigned both = 0;
            for (int py = y0; py < y1; ++py) {
                for (int px = x0; px < x1; ++px) {
                    both += view.mask[static_cast<std::size_t>(py) * view.camera.width + px] != 0;
                }
            }
            atomicAdd(&covered, static_cast<unsigned>((x1 - x0) * (y1 - y0)));
            atomicAdd(&shared_px, both);
        }
    }
    __syncthreads();
    if (threadIdx.x == 0 && covered > 0) {
        atomicAdd(view.counts + 1, static_cast<unsigned long long>(covered));
        atomicAdd(view.counts + 2, static_cast<unsigned long long>(shared_px));
    }
}

}  // namespace

void DeviceViews::frame(const Stream& stream, std::span<const ColouringView> views, const Lattice& lattice,
                        const DeviceVolume& volume, float max_difference_std, float noise_grey) {
    views_.resize(views.size());
    for (std::size_t n = 0; n < views.size(); ++n) {
        views_[n] = {};
        views_[n].camera = make_projector(*views[n].camera, "colouring: camera");
    }
    find_cells(stream, lattice, volume);
    place_images(stream, views);
    if (max_cells_ == 0) return;
    std::size_t max_with_rim = 0;
    for (int n = 0; n < count(); ++n) {
        max_with_rim =
            std::max(max_with_rim, static_cast<std::size_t>(views_[n].width + 2) * (views_[n].height + 2));
    }
    cell_means<<<blocks(max_with_rim, count()), kThreads, 0, stream.get()>>>(device_views_.data());
    cell_colours<<<blocks(max_cells_, count()), kThreads, 0, stream.get()>>>(device_views_.data(),
                                                                             max_difference_std, noise_grey);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void DeviceViews::find_cells(const Stream& stream, const Lattice& lattice, const DeviceVolume& volume) {
    host_boxes_.resize(4 * views_.size());
    for (int n = 0; n < count(); ++n) {
        const Projector& c = views_[n].camera;
        host_boxes_[4 * n] = c.width, host_boxes_[4 * n + 1] = c.height;
        host_boxes_[4 * n + 2] = host_boxes_[4 * n + 3] = 0;
    }
    upload(stream, device_views_, views_);
    upload(stream, boxes_, host_boxes_);
    sums_.resize(2 * views_.size());
    host_sums_.resize(sums_.size());
    fill_bytes(stream, sums_.data(), 0, sums_.size());
    if (volume.brick_count() > 0) {
        frame_bricks<<<blocks(volume.brick_count(), count()), kThreads, 0, stream.get()>>>(
            device_views_.data(), volume.bricks(), volume.brick_count(), lattice, boxes_.data(),
            sums_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
    }
    download(stream, host_boxes_.data(), boxes_.data(), boxes_.size());
    download(stream, host_sums_.data(), sums_.data(), sums_.size());
    stream.wait();
    for (int n = 0; n < count(); ++n) {
        const Rect px{host_boxes_[4 * n], host_boxes_[4 * n + 1], host_boxes_[4 * n + 2],
                      host_boxes_[4 * n + 3]};
        ViewOfVolume framed;
        framed.camera = views_[n].camera;
        finish_frame(lattice.voxel_m, px, static_cast<double>(host_sums_[2 * n]) / kDepthUnit,
                     static_cast<int>(host_sums_[2 * n + 1]), framed);
        views_[n].shift = framed.shift;
        views_[n].cells = framed.cells;
        views_[n].width = framed.cells.width();
        views_[n].height = framed.cells.height();
    }
}

void DeviceViews::place_images(const Stream& stream, std::span<const ColouringView> views) {
    std::size_t cells = 0, rims = 0, byte_count = 0;
    max_cells_ = max_px_ = 0;
    for (int n = 0; n < count(); ++n) {
        ViewOnDevice& view = views_[n];
        const Projector& c = view.camera;
        const std::size_t here = static_cast<std::size_t>(view.width) * view.height;
        cells += here;
        rims += static_cast<std::size_t>(view.width + 2) * (view.height + 2);
        max_cells_ = std::max(max_cells_, here);
        max_px_ = std::max(max_px_, static_cast<std::size_t>(c.width) * c.height);
        if (views[n].image.data && here > 0) {
            view.channels = views[n].image.channels;
            view.image_box = {std::max(view.cells.x0 - 1, 0) << view.shift,
                              std::max(view.cells.y0 - 1, 0) << view.shift,
                              std::min((view.cells.x1 + 1) << view.shift, c.width),
                              std::min((view.cells.y1 + 1) << view.shift, c.height)};
            byte_count +=
                static_cast<std::size_t>(view.image_box.width()) * view.image_box.height() * view.channels;
        }
        if (views[n].sharp || views[n].silhouette) byte_count += static_cast<std::size_t>(c.width) * c.height;
    }
    host_bytes_.resize(byte_count);
    bytes_.resize(byte_count);
    means_.resize(3 * rims);
    colours_.resize(cells);
    depths_.resize(4 * cells);
    nearest_.resize(views_.size());
    counts_.resize(3 * views_.size());
    std::size_t cell_at = 0, rim_at = 0, byte_at = 0;
    for (int n = 0; n < count(); ++n) {
        ViewOnDevice& view = views_[n];
        const std::size_t here = static_cast<std::size_t>(view.width) * view.height;
        view.front_m = depths_.data() + cell_at, view.back_m = depths_.data() + cells + cell_at;
        view.front_scratch = depths_.data() + 2 * cells + cell_at;
        view.back_scratch = depths_.data() + 3 * cells + cell_at;
        view.colours = colours_.data() + cell_at;
        view.means = means_.data() + 3 * rim_at;
        view.nearest = nearest_.data() + n;
        view.counts = counts_.data() + 3 * n;
        cell_at += here;
        rim_at += static_cast<std::size_t>(view.width + 2) * (view.height + 2);
        if (view.channels > 0) {
            view.image = bytes_.data() + byte_at;
            const Rect& box = view.image_box;
            const std::size_t row_bytes = static_cast<std::size_t>(box.width()) * view.channels;
            for (int y = box.y0; y < box.y1; ++y, byte_at += row_bytes) {
                std::memcpy(host_bytes_.data() + byte_at, views[n].image.row(y) + box.x0 * view.channels,
                            row_bytes);
            }
        }
        if (const std::uint8_t* mask = views[n].sharp ? views[n].sharp : views[n].silhouette) {
            const std::size_t size = static_cast<std::size_t>(view.camera.width) * view.camera.height;
            std::memcpy(host_bytes_.data() + byte_at, mask, size);
            view.mask = bytes_.data() + byte_at;
            const Rect whole{0, 0, view.camera.width, view.camera.height};
            view.mask_box = views[n].bounds.empty() ? whole : views[n].bounds;
            byte_at += size;
        }
    }
    upload(stream, bytes_, host_bytes_);
    upload(stream, device_views_, views_);
}

void DeviceViews::look(const Stream& stream, const Lattice& lattice, const SurfaceList& surface) {
    cells_.resize(static_cast<std::size_t>(count()) * surface.count);
    voxel_cells_ = {cells_.data(), surface.count};
    clear_depth<<<blocks(std::max<std::size_t>(max_cells_, 1), count()), kThreads, 0, stream.get()>>>(
        device_views_.data());
    if (surface.count > 0) {
        splat<<<blocks(surface.count, count()), kThreads, 0, stream.get()>>>(device_views_.data(), lattice,
                                                                             surface, voxel_cells_);
    }
    if (surface.count > 0 && max_cells_ > 0) {
        widen_rows<<<blocks(max_cells_, count()), kThreads, 0, stream.get()>>>(device_views_.data(),
                                                                               lattice.voxel_m);
        widen_columns<<<blocks(max_cells_, count()), kThreads, 0, stream.get()>>>(device_views_.data(),
                                                                                  lattice.voxel_m);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

std::vector<float> DeviceViews::silhouette_iou(const Stream& stream, float voxel_m) {
    fill_bytes(stream, counts_.data(), 0, counts_.size());
    count_mask<<<blocks(max_px_, count()), kThreads, 0, stream.get()>>>(device_views_.data());
    if (max_cells_ > 0) {
        count_projection<<<blocks(max_cells_, count()), kThreads, 0, stream.get()>>>(device_views_.data(),
                                                                                     voxel_m);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
    host_sums_.resize(counts_.size());
    download(stream, host_sums_.data(), counts_.data(), counts_.size());
    stream.wait();
    std::vector<float> iou(views_.size(), std::numeric_limits<float>::quiet_NaN());
    for (int n = 0; n < count(); ++n) {
        const unsigned long long both = host_sums_[3 * n + 2];
        const unsigned long long either = host_sums_[3 * n] + host_sums_[3 * n + 1] - both;
        if (views_[n].mask && either > 0) iou[n] = static_cast<float>(both) / static_cast<float>(either);
    }
    return iou;
}

}  // namespace kinevox::kernels::cuda
