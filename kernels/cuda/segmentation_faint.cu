// Blocks that differ faintly from the background, by kernels/shared/kde_faint.h.
#include <algorithm>

#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

// The differences of a block that lies in the image.
template <int kChannels, class Value>
__device__ kde::BlockDifference block_difference(const SegmentData& d, int row, int column,
                                                 const Value& value) {
    constexpr int kBlock = kde::kFaintBlock_px;
    kde::BlockDifference block;
    for (int c = 0; c < kChannels; ++c) {
        int sum = 0, squares = 0;
        for (int n = 0; n < kde::kFaintPixels; ++n) {
            const int y = row * kBlock + n / kBlock, x = column * kBlock + n % kBlock;
            const std::size_t at =
                (d.cell(y, x / kCellPixels) * kChannels + c) * kCellPixels + x % kCellPixels;
            const int difference = kde::scaled_difference(value(y, x, c, at), d.reference[at], d.scale[at]);
            sum += difference;
            squares += difference * difference;
        }
        kde::add_channel(block, sum, squares);
    }
    return block;
}

// The usual difference of the image's blocks from the background, a block of threads a camera.
template <int kChannels>
__global__ void __launch_bounds__(kMedianThreads) noise_kernel(const SegmentData* __restrict__ cameras) {
    static_assert(kde::kNoiseBins == kMedianThreads);
    __shared__ int means[kde::kNoiseBins], pixels[kde::kNoiseBins], warp_sums[32], median[2];
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look || !d.judge_faint) return;
    const int n = static_cast<int>(threadIdx.x);
    const int rows = d.height / kde::kFaintBlock_px, columns = d.width / kde::kFaintBlock_px;
    const int step = kde::noise_row_step(rows), measured = (rows - step / 2 + step - 1) / step;
    means[n] = pixels[n] = 0;
    if (n < 2) median[n] = 0;
    __syncthreads();
    for (int i = n; i < measured * columns; i += kMedianThreads) {
        const auto corrected_at = [&](int y, int x, int c, std::size_t) {
            return corrected(d.image[(static_cast<std::size_t>(y) * d.width + x) * kChannels + c],
                             static_cast<unsigned>(d.state->gain_64[c]));
        };
        const kde::BlockDifference block =
            block_difference<kChannels>(d, step / 2 + i / columns * step, i % columns, corrected_at);
        atomicAdd(means + kde::noise_bin(block.mean, kde::kMeanBinShift), 1);
        atomicAdd(pixels + kde::noise_bin(block.pixel, kde::kPixelBinShift), 1);
    }
    __syncthreads();
    find_median(means, warp_sums, median);
    find_median(pixels, warp_sums, median + 1);
    if (n > 0) return;
    d.state->usual = kde::usual_difference(median[0], median[1], kChannels);
    d.state->noise_factor = kde::noise_factor(d.state->usual, kChannels, d.parameters.noise_fraction);
}

// A thread a row of blocks and a cell: finds its faint blocks.
template <int kChannels>
__global__ void faint_kernel(const SegmentData* __restrict__ cameras) {
    const SegmentData& d = cameras[blockIdx.z];
    if (!d.look || !d.judge_faint) return;
    constexpr int kBlock = kde::kFaintBlock_px;
    const int n = thread_index() / kde::kFaintBlocks, block = thread_index() % kde::kFaintBlocks;
    const int row = n / d.cells_per_row, k = n % d.cells_per_row, column = k * kde::kFaintBlocks + block;
    bool faint = false;
    if (row < d.height / kBlock && column < d.width / kBlock && d.work.holds(row * kBlock, k) &&
        d.work.holds(row * kBlock + kBlock - 1, k)) {
        const auto value_at = [&](int, int, int, std::size_t at) { return static_cast<int>(d.values[at]); };
        faint = kde::is_faint(block_difference<kChannels>(d, row, column, value_at), d.state->usual);
    }
    const unsigned both = __ballot_sync(0xffffffffu, faint);  // of two cells
    if (block == 0 && row < d.vote_rows())
        d.faint[n] = static_cast<std::uint16_t>(both >> threadIdx.x % 32 & 0xffff);
}
static_assert(2 * kde::kFaintBlocks == 32);

}  // namespace

void queue_faint_blocks(const Stream& stream, const FrameSet& cameras) {
    const int count = static_cast<int>(cameras.host.size());
    if (std::none_of(cameras.host.begin(), cameras.host.end(),
                     [](const SegmentData& d) { return d.judge_faint; }))
        return;
    const auto z = static_cast<unsigned>(count);
    const unsigned threads = kde::kFaintBlocks * max_of(cameras, count, [](const SegmentData& d) {
                                 return d.vote_rows() * d.cells_per_row;
                             });
    const dim3 all((threads + kThreads - 1) / kThreads, 1, z);
    if (cameras.channels == 1) {
        noise_kernel<1><<<dim3(1, 1, z), kMedianThreads, 0, stream.get()>>>(cameras.device);
        faint_kernel<1><<<all, kThreads, 0, stream.get()>>>(cameras.device);
    } else {
        noise_kernel<3><<<dim3(1, 1, z), kMedianThreads, 0, stream.get()>>>(cameras.device);
        faint_kernel<3><<<all, kThreads, 0, stream.get()>>>(cameras.device);
    }
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
