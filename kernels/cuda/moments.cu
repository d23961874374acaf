// The moments on the device: whole-number sums, the grid, its four folds, then a block a moment. Sums run in
// a fixed order, so that the same mask gives the same bits; the mapping comes from the host's code and is the
// CPU form's.
#include <cuda_runtime.h>

#include <algorithm>
#include <cstdint>
#include <vector>

#include "kernels/cpu/moment_tables.h"
#include "kernels/cpu/moments.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/shared/moments.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

constexpr int kProjectThreads = 128;

// A silhouette's pixels within its bounds, rows without gaps.
struct PackedMask {
    const std::uint8_t* pixels;
    Rect bounds;
    DiskMapping mapping;
};

struct DeviceSums {  // as MaskSums; unsigned, because that is what atomics add: bounds begin at 0 here
    unsigned long long mass, x, y, squares;
};

__global__ void sum_masks(const PackedMask* masks, DeviceSums* sums) {
    const PackedMask mask = masks[blockIdx.y];
    const int width = mask.bounds.x1 - mask.bounds.x0, count = width * (mask.bounds.y1 - mask.bounds.y0);
    DeviceSums own{};
    for (int n = thread_index(); n < count; n += gridDim.x * blockDim.x) {
        const unsigned long long value = mask.pixels[n], x = n % width, y = n / width;
        own.mass += value;
        own.x += value * x;
        own.y += value * y;
        own.squares += value * (x * x + y * y);
    }
    DeviceSums& out = sums[blockIdx.y];
    if (own.mass == 0) return;
    atomicAdd(&out.mass, own.mass);
    atomicAdd(&out.x, own.x);
    atomicAdd(&out.y, own.y);
    atomicAdd(&out.squares, own.squares);
}

// A thread a cell: the same sums in the same order as the CPU form.
__global__ void average_cells(const PackedMask* masks, int grid, float* cells) {
    const int n = thread_index();
    if (n >= grid * grid) return;
    const PackedMask mask = masks[blockIdx.y];
    const Rect& box = mask.bounds;
    const DiskMapping& m = mask.mapping;
    const CellSpan columns = cell_span(m.centre_x_px, m.radius_px, grid, n % grid, box.x0, box.x1);
    const CellSpan rows = cell_span(m.centre_y_px, m.radius_px, grid, n / grid, box.y0, box.y1);
    float sum = 0;
    if (columns.end > columns.begin && rows.end > rows.begin) {
        for (int x = static_cast<int>(columns.begin); x < box.x1 && static_cast<float>(x) < columns.end;
             ++x) {
            float line = 0;
            for (int y = static_cast<int>(rows.begin); y < box.y1 && static_cast<float>(y) < rows.end; ++y)
                line += pixel_coverage(rows, y) *
                        static_cast<float>(mask.pixels[(y - box.y0) * (box.x1 - box.x0) + x - box.x0]);
            sum += pixel_coverage(columns, x) * line;
        }
    }
    const float cell_px = 2 * m.radius_px / static_cast<float>(grid);
    cells[static_cast<std::size_t>(blockIdx.y) * grid * grid + n] = 1 / (255.f * cell_px * cell_px) * sum;
}

// `place` holds row and column of each kept cell of the quadrant.
__global__ void fold_cells(const float* cells, int grid, const short2* place, int count, float* folds) {
    const int n = thread_index(), half = grid / 2;
    if (n >= count) return;
    const float* in = cells + static_cast<std::size_t>(blockIdx.y) * grid * grid;
    const int row = place[n].x, column = place[n].y;
    const float* down = in + (half + row) * grid + half;
    const float* up = in + (half - 1 - row) * grid + half;
    for (int fold = 0; fold < kMomentFolds; ++fold)
        folds[(static_cast<std::size_t>(blockIdx.y) * kMomentFolds + fold) * count + n] =
            folded(fold, down[column], down[-1 - column], up[column], up[-1 - column]);
}

// One block a function (x) and silhouette (y). `function`: fold and index of the value.
__global__ void project_folds(const float* weights, const int2* function, const float* folds, int count,
                              int values, float* out) {
    __shared__ float sums[kProjectThreads];
    const int2 f = function[blockIdx.x];
    const float* w = weights + static_cast<std::size_t>(blockIdx.x) * count;
    const float* in = folds + (static_cast<std::size_t>(blockIdx.y) * kMomentFolds + f.x) * count;
    float sum = 0;
    for (int n = threadIdx.x; n < count; n += kProjectThreads) sum += w[n] * in[n];
    sums[threadIdx.x] = sum;
    for (int step = kProjectThreads / 2; step > 0; step /= 2) {
        __syncthreads();
        if (threadIdx.x < step) sums[threadIdx.x] += sums[threadIdx.x + step];
    }
    if (threadIdx.x == 0) out[static_cast<std::size_t>(blockIdx.y) * values + f.y] = sums[0];
}

class CudaMomentCalculator final : public MomentCalculator {
  public:
    CudaMomentCalculator(int gpu, const MomentOptions& options)
        : options_(options), tables_(moment_tables(options.order, options.grid)), stream_(gpu) {
        PinnedBuffer<float> weights;
        weights.resize(tables_->weights.size());
        std::copy(tables_->weights.begin(), tables_->weights.end(), weights.data());
        PinnedBuffer<int2> functions;
        functions.resize(moment_values(options.order));
        for (int fold = 0; fold < kMomentFolds; ++fold)
            for (const auto& function : tables_->functions[fold])
                functions[function.row] = {fold, function.value};
        PinnedBuffer<short2> place;
        place.resize(tables_->cells);
        for (int row = 0; row < tables_->half; ++row)
            for (int column = 0; column < tables_->row_cells[row]; ++column)
                place[tables_->row_start[row] + column] = {static_cast<short>(row),
                                                           static_cast<short>(column)};
        upload(stream_, weights_, weights);
        upload(stream_, functions_, functions);
        upload(stream_, place_, place);
        stream_.wait();
    }

    void compute(std::span<const MomentView> views, std::vector<SilhouetteMoments>& out) override {
        out.resize(views.size());
        if (views.empty()) return;
        stream_.use();
        const int count = static_cast<int>(views.size());
        upload_masks(views);
        sums_.resize(count);
        fill_bytes(stream_, sums_.data(), 0, count);
        sum_masks<<<dim3(32, count), kThreads, 0, stream_.get()>>>(device_masks_.data(), sums_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        host_sums_.resize(count);
        download(stream_, host_sums_.data(), sums_.data(), count);
        stream_.wait();
        std::vector<bool> present(count);
        for (int n = 0; n < count; ++n) {
            present[n] = map_to_disk(in_image(host_sums_[n], views[n].bounds), views[n],
                                     options_.disk_per_gyration, out[n]);
            masks_[n].mapping = present[n] ? out[n].mapping : DiskMapping{0, 0, 1};
        }
        launch(count);
        const int values = moment_values(options_.order);
        for (int n = 0; n < count; ++n) {
            const float* from = host_values_.data() + static_cast<std::size_t>(n) * values;
            if (present[n]) {
                out[n].values.assign(from, from + values);
            } else {
                out[n].values.assign(values, 0.f);
            }
        }
    }

  private:
    static MaskSums in_image(const DeviceSums& s, const Rect& box) {
        const auto mass = static_cast<std::int64_t>(s.mass), x = static_cast<std::int64_t>(s.x),
                   y = static_cast<std::int64_t>(s.y), x0 = static_cast<std::int64_t>(box.x0),
                   y0 = static_cast<std::int64_t>(box.y0);
        return {mass, x + mass * x0, y + mass * y0,
                static_cast<std::int64_t>(s.squares) + 2 * (x * x0 + y * y0) + mass * (x0 * x0 + y0 * y0)};
    }

    void upload_masks(std::span<const MomentView> views) {
        std::size_t bytes = 0;
        const auto is_there = [](const MomentView& view) { return view.mask && !view.bounds.empty(); };
        for (const MomentView& view : views)
            if (is_there(view)) bytes += static_cast<std::size_t>(view.bounds.width()) * view.bounds.height();
        host_pixels_.resize(bytes);
        pixels_.resize(bytes);
        masks_.resize(views.size());
        std::size_t at = 0;
        for (std::size_t n = 0; n < views.size(); ++n) {
            const Rect box = is_there(views[n]) ? views[n].bounds : Rect{};
            masks_[n] = {pixels_.data() + at, box, {0, 0, 1}};
            for (int y = box.y0; y < box.y1; ++y, at += static_cast<std::size_t>(box.width()))
                std::copy_n(views[n].mask + y * views[n].stride + box.x0, box.width(),
                            host_pixels_.data() + at);
        }
        upload(stream_, pixels_, host_pixels_);
        upload(stream_, device_masks_, masks_);
    }

    void launch(int count) {
        const int grid = options_.grid, kept = tables_->cells, values = moment_values(options_.order);
        upload(stream_, device_masks_, masks_);  // now with the mappings
        cells_.resize(static_cast<std::size_t>(count) * grid * grid);
        folds_.resize(static_cast<std::size_t>(count) * kMomentFolds * kept);
        values_.resize(static_cast<std::size_t>(count) * values);
        host_values_.resize(values_.size());
        average_cells<<<blocks(static_cast<std::size_t>(grid) * grid, count), kThreads, 0, stream_.get()>>>(
            device_masks_.data(), grid, cells_.data());
        fold_cells<<<blocks(kept, count), kThreads, 0, stream_.get()>>>(cells_.data(), grid, place_.data(),
                                                                        kept, folds_.data());
        project_folds<<<dim3(values, count), kProjectThreads, 0, stream_.get()>>>(
            weights_.data(), functions_.data(), folds_.data(), kept, values, values_.data());
        KINEVOX_CUDA_CHECK(cudaGetLastError());
        download(stream_, host_values_.data(), values_.data(), values_.size());
        stream_.wait();
    }

    MomentOptions options_;
    std::shared_ptr<const MomentTables> tables_;
    Stream stream_;
    DeviceBuffer<float> weights_, cells_, folds_, values_;
    DeviceBuffer<int2> functions_;
    DeviceBuffer<short2> place_;
    DeviceBuffer<std::uint8_t> pixels_;
    DeviceBuffer<PackedMask> device_masks_;
    DeviceBuffer<DeviceSums> sums_;
    PinnedBuffer<std::uint8_t> host_pixels_;
    PinnedBuffer<PackedMask> masks_;
    PinnedBuffer<DeviceSums> host_sums_;
    PinnedBuffer<float> host_values_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<MomentCalculator> make_moment_calculator_cuda(int gpu, const MomentOptions& options) {
    cuda::require_gpu("moments", gpu);
    return std::make_unique<cuda::CudaMomentCalculator>(gpu, options);
}

}  // namespace kinevox::kernels
