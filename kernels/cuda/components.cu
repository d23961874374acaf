// Cleaning of masks by connected components. A mask's rows are runs of pixels; each run points at the first
// run above that it touches, pointer jumping flattens the trees that arise, and what touches further runs is
// joined by union-find with few steps left. So a silhouette takes one block of threads some microseconds,
// and no launch has to wait for another one. The root of a component is its first run, whatever the order of
// the threads.
#include "kernels/cuda/components.h"

namespace kinevox::kernels::cuda {
namespace {

using kde::kCellPixels;

constexpr int kMaskThreads = 1024;  // one block a mask, a thread a row or a run
constexpr int kSharedRuns = 2048;   // a mask of more is joined in global memory
constexpr int kTouchesBorder = 1, kTouchesSeed = 2;
constexpr unsigned kAllLanes = 0xffffffffu;

struct Scratch {
    int parent[kSharedRuns], area[kSharedRuns], flags[kSharedRuns];
    int warp_sums[32];
    int largest, runs;  // of remove_small_components()
};

// The part of a mask in the active box, which has all that is set.
struct BoxMask {
    Word* words;
    int width, cells_per_row;
    CellRange box;

    __device__ Word* row(int n) const { return words + static_cast<std::size_t>(box.y0 + n) * cells_per_row; }
    // The pixels of a word of a row that are set, or those that are not.
    __device__ Word pixels(const Word* row, int k, bool set) const {
        const int end = width - k * kCellPixels;
        const Word valid = end < kCellPixels ? (Word{1} << end) - 1 : ~Word{0};
        return (set ? row[k] : ~row[k]) & valid;
    }
    __device__ int x0() const { return box.k0 * kCellPixels; }
    __device__ int x1() const { return min(box.k1 * kCellPixels, width); }
};

__device__ int lowest_bit(Word bits) {
    return __ffsll(static_cast<long long>(bits)) - 1;
}

// The pixels of a word in [x0, x1), counted from its first one.
__device__ Word range_of(int x0, int x1) {
    const Word below_end = x1 >= kCellPixels ? ~Word{0} : (Word{1} << x1) - 1;
    return x0 <= 0 ? below_end : below_end & ~((Word{1} << x0) - 1);
}

// Calls body(k, pixels) for the words that pixels [x0, x1) of a row share.
template <class F>
__device__ void for_each_word(int x0, int x1, const F& body) {
    for (int k = x0 / kCellPixels; k * kCellPixels < x1; ++k)
        body(k, range_of(x0 - k * kCellPixels, x1 - k * kCellPixels));
}

// A run's pixels [x0, x1).
__device__ unsigned span_of(int x0, int x1) {
    return static_cast<unsigned>(x0) | static_cast<unsigned>(x1) << 16;
}
__device__ int begin_of(unsigned span) {
    return static_cast<int>(span & 0xffffu);
}
__device__ int end_of(unsigned span) {
    return static_cast<int>(span >> 16);
}

__device__ int count_runs(const BoxMask& mask, int row, bool set) {
    const Word* words = mask.row(row);
    int count = 0;
    Word carry = 0;
#pragma unroll 8
    for (int k = mask.box.k0; k < mask.box.k1; ++k) {
        const Word pixels = mask.pixels(words, k, set);
        count += __popcll(pixels & ~(pixels << 1 | carry));
        carry = pixels >> (kCellPixels - 1);
    }
    return count;
}

// Calls body(x0, x1) for the runs of a row, from the left.
template <class F>
__device__ void for_each_run(const BoxMask& mask, int row, bool set, const F& body) {
    const Word* words = mask.row(row);
    int first = -1;  // of a run that is not at its end
    for (int k = mask.box.k0; k < mask.box.k1; ++k) {
        const int x = k * kCellPixels;
        Word pixels = mask.pixels(words, k, set);
        if (first >= 0) {
            if (pixels == ~Word{0}) continue;
            const int length = lowest_bit(~pixels);
            body(first, x + length);
            first = -1;
            pixels &= ~Word{0} << length;
        }
        while (pixels != 0) {
            const int begin = lowest_bit(pixels);
            const Word after = ~(pixels >> begin);
            const int length = after == 0 ? kCellPixels : lowest_bit(after);
            if (begin + length >= kCellPixels) {
                first = x + begin;
                break;
            }
            body(x + begin, x + begin + length);
            pixels &= ~Word{0} << (begin + length);
        }
    }
    if (first >= 0) body(first, mask.x1());
}

// values[n] becomes the sum of those before it, values[count] that of all.
__device__ int exclusive_scan_of_block(int* values, int count, int* warp_sums) {
    const int n = static_cast<int>(threadIdx.x);
    int total = 0;
    for (int first = 0; first < count; first += kMaskThreads) {
        const int value = first + n < count ? values[first + n] : 0,
                  sum = inclusive_sum_of_block(value, warp_sums);
        if (first + n < count) values[first + n] = total + sum - value;
        total += warp_sums[31];
        __syncthreads();
    }
    if (n == 0) values[count] = total;
    __syncthreads();
    return total;
}

// Halves the path on its way, so that the next one is shorter.
__device__ int root_of(int* parent, int n) {
    const volatile int* now = parent;  // other threads lower parents meanwhile
    for (int next = now[n]; next != n; next = now[n]) {
        const int above = now[next];
        if (above == next) return next;
        atomicMin(parent + n, above);
        n = above;
    }
    return n;
}

__device__ void unite(int* parent, int a, int b) {
    for (;;) {
        a = root_of(parent, a);
        b = root_of(parent, b);
        if (a == b) return;
        const int high = a > b ? a : b, low = a > b ? b : a;
        const int before = atomicMin(parent + high, low);
        if (before == high) return;
        a = before, b = low;  // another thread was faster: `high` is now attached to `before`
    }
}

// Lets every run point at its root. Several steps at once, since a round costs a barrier.
__device__ void flatten(int* parent, int count) {
    constexpr int kSteps = 4;
    const volatile int* now = parent;
    bool moved;
    do {
        moved = false;
        for (int n = static_cast<int>(threadIdx.x); n < count; n += kMaskThreads) {
            const int next = now[n];
            int root = next;
            for (int step = 0; step < kSteps; ++step) root = now[root];
            if (root == next) continue;
            atomicMin(parent + n, root);
            moved = true;
        }
    } while (__syncthreads_or(moved));
}

// The runs of a mask and their components, with areas and flags at each component's first run.
struct Components {
    RunLists lists;
    int count = 0;

    // Calls body(run, above, first) for the runs of a row and those above that they touch; `first`: of this
    // run. gap: 1 where diagonals touch, else 0.
    template <class F>
    __device__ void for_each_contact(int row, int gap, const F& body) const {
        int above = lists.row_begin[row - 1];
        const int end = lists.row_begin[row];
        for (int run = end; run < lists.row_begin[row + 1]; ++run) {
            const int x0 = begin_of(lists.spans[run]), x1 = end_of(lists.spans[run]);
            while (above < end && end_of(lists.spans[above]) + gap <= x0) ++above;
            for (int n = above; n < end && begin_of(lists.spans[n]) < x1 + gap; ++n) body(run, n, n == above);
        }
    }

    // Calls body(run, row) for all runs; those of a row by one thread.
    template <class F>
    __device__ void for_each(int rows, const F& body) const {
        for (int row = static_cast<int>(threadIdx.x); row < rows; row += kMaskThreads)
            for (int run = lists.row_begin[row]; run < lists.row_begin[row + 1]; ++run) body(run, row);
    }
};

// Finds the components of what is set, with diagonals, or of what is not, without. Every
// component counts as seeded where `seed` has no words.
__device__ Components find_components(const BoxMask& mask, bool set, const ExpectedMask& seed,
                                      const RunLists& room, Scratch& scratch) {
    const int rows = mask.box.rows(), gap = set ? 1 : 0, thread = static_cast<int>(threadIdx.x);
    for (int row = thread; row < rows; row += kMaskThreads) room.row_begin[row] = count_runs(mask, row, set);
    __syncthreads();
    Components found{room, exclusive_scan_of_block(room.row_begin, rows, scratch.warp_sums)};
    RunLists& lists = found.lists;
    if (found.count <= kSharedRuns)
        lists.parent = scratch.parent, lists.area = scratch.area, lists.flags = scratch.flags;
    for (int row = thread; row < rows; row += kMaskThreads) {
        int run = lists.row_begin[row];
        for_each_run(mask, row, set, [&](int x0, int x1) {
            lists.spans[run] = span_of(x0, x1);
            lists.parent[run] = run;
            lists.area[run] = lists.flags[run] = 0;
            ++run;
        });
    }
    __syncthreads();
    for (int row = thread; row < rows; row += kMaskThreads)
        if (row > 0)
            found.for_each_contact(row, gap, [&](int run, int above, bool first) {
                if (first) lists.parent[run] = above;
            });
    __syncthreads();
    flatten(lists.parent, found.count);
    for (int row = thread; row < rows; row += kMaskThreads)
        if (row > 0)
            found.for_each_contact(row, gap, [&](int run, int above, bool first) {
                if (!first) unite(lists.parent, run, above);
            });
    __syncthreads();
    flatten(lists.parent, found.count);
    found.for_each(rows, [&](int run, int row) {
        const int x0 = begin_of(lists.spans[run]), x1 = end_of(lists.spans[run]), root = lists.parent[run];
        atomicAdd(lists.area + root, x1 - x0);
        const bool border = row == 0 || row + 1 == rows || x0 == mask.x0() || x1 == mask.x1();
        bool seeded = seed.words == nullptr;
        if (!seeded)
            for_each_word(x0, x1, [&](int k, Word pixels) {
                seeded = seeded || (seed.at(mask.box.y0 + row, k) & pixels) != 0;
            });
        const int flags = (border ? kTouchesBorder : 0) | (seeded ? kTouchesSeed : 0);
        if (flags) atomicOr(lists.flags + root, flags);
    });
    __syncthreads();
    return found;
}

// As cpu::remove_small_components(); returns the area of the largest component.
__device__ int remove_small_components(const BoxMask& mask, int min_area, float min_fraction,
                                       const ExpectedMask& seed, const RunLists& room, Scratch& scratch) {
    if (threadIdx.x == 0) scratch.largest = 0;
    const Components found = find_components(mask, true, seed, room, scratch);
    const RunLists& lists = found.lists;
    for (int run = static_cast<int>(threadIdx.x); run < found.count; run += kMaskThreads)
        if (lists.parent[run] == run && lists.flags[run] & kTouchesSeed)
            atomicMax(&scratch.largest, lists.area[run]);
    if (threadIdx.x == 0) scratch.runs = found.count;
    __syncthreads();
    const int largest = scratch.largest;
    const double part = static_cast<double>(min_fraction) * static_cast<double>(largest);
    const double bound = part > min_area ? part : static_cast<double>(min_area);
    found.for_each(mask.box.rows(), [&](int run, int row) {
        const int root = lists.parent[run];
        if (lists.flags[root] & kTouchesSeed && lists.area[root] >= bound) return;
        for_each_word(begin_of(lists.spans[run]), end_of(lists.spans[run]),
                      [&](int k, Word pixels) { mask.row(row)[k] &= ~pixels; });
    });
    __syncthreads();
    return largest;
}

// As cpu::fill_holes().
__device__ void fill_holes(const BoxMask& mask, int max_area, const RunLists& room, Scratch& scratch) {
    const Components found = find_components(mask, false, {}, room, scratch);
    const RunLists& lists = found.lists;
    found.for_each(mask.box.rows(), [&](int run, int row) {
        const int root = lists.parent[run];
        if (lists.area[root] >= max_area || lists.flags[root] & kTouchesBorder) return;
        for_each_word(begin_of(lists.spans[run]), end_of(lists.spans[run]),
                      [&](int k, Word pixels) { mask.row(row)[k] |= pixels; });
    });
    __syncthreads();
}

// A block a camera and mask.
__global__ void __launch_bounds__(kMaskThreads) cleaning_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ Scratch scratch;
    const SegmentData& d = cameras[blockIdx.z];
    const CellRange box = d.state->box;
    if (box.empty()) return;
    const BoxMask mask{blockIdx.x == 0 ? d.loose : d.sharp, d.width, d.cells_per_row, box};
    const RunLists& room = d.runs[blockIdx.x];
    const int largest = remove_small_components(mask, d.min_component_px, d.min_component_fraction,
                                                d.tracked ? d.expected : ExpectedMask{}, room, scratch);
    if (blockIdx.x == 0 && threadIdx.x == 0) d.state->found = scratch.runs > 0;
    const int part = static_cast<int>(d.max_hole_fraction * static_cast<float>(largest));
    fill_holes(mask, max(part, d.max_hole_px), room, scratch);
}

// The sum of the positions of the pixels set.
__device__ int places_of(Word pixels) {
    return __popcll(pixels & 0xaaaaaaaaaaaaaaaaull) + 2 * __popcll(pixels & 0xccccccccccccccccull) +
           4 * __popcll(pixels & 0xf0f0f0f0f0f0f0f0ull) + 8 * __popcll(pixels & 0xff00ff00ff00ff00ull) +
           16 * __popcll(pixels & 0xffff0000ffff0000ull) + 32 * __popcll(pixels & 0xffffffff00000000ull);
}

// What a thread's rows add to the result.
struct Measures {
    Word pixels = 0, x = 0, y = 0;
    int x0, y0, x1 = 0, y1 = 0;

    __device__ void add(int row_y, int k, Word sharp, Word loose) {
        const auto count = static_cast<Word>(__popcll(sharp));
        pixels += count;
        x += count * static_cast<Word>(k * kCellPixels) + static_cast<Word>(places_of(sharp));
        y += count * static_cast<Word>(row_y);
        if (loose == 0) return;
        int last = kCellPixels - 1;
        while (!(loose >> last & 1)) --last;
        x0 = min(x0, k * kCellPixels + lowest_bit(loose)), x1 = max(x1, k * kCellPixels + last + 1);
        y0 = min(y0, row_y), y1 = max(y1, row_y + 1);
    }
};

__device__ Word sum_of_warp(Word value) {
    for (int step = 16; step > 0; step /= 2) {
        const int low = __shfl_xor_sync(kAllLanes, static_cast<int>(value & 0xffffffffu), step);
        const int high = __shfl_xor_sync(kAllLanes, static_cast<int>(value >> 32), step);
        value += static_cast<Word>(static_cast<unsigned>(low)) |
                 static_cast<Word>(static_cast<unsigned>(high)) << 32;
    }
    return value;
}

// By the whole block.
__device__ void store_result(const SegmentData& d, const CellRange& box, const Measures& own) {
    __shared__ Word sums[3][kMaskThreads / 32];
    __shared__ int bounds[4];
    const int thread = static_cast<int>(threadIdx.x);
    if (thread == 0) bounds[0] = d.width, bounds[1] = d.height, bounds[2] = bounds[3] = 0;
    const Word pixels = sum_of_warp(own.pixels), x = sum_of_warp(own.x), y = sum_of_warp(own.y);
    if (thread % 32 == 0) sums[0][thread / 32] = pixels, sums[1][thread / 32] = x, sums[2][thread / 32] = y;
    __syncthreads();
    if (own.y1 > 0) {
        atomicMin(bounds, own.x0), atomicMin(bounds + 1, own.y0);
        atomicMax(bounds + 2, own.x1), atomicMax(bounds + 3, own.y1);
    }
    __syncthreads();
    if (thread < 3) {
        Word sum = 0;
        for (const Word part : sums[thread]) sum += part;
        d.result->sums[thread] = sum;
    }
    if (thread < 4) d.result->bounds[thread] = bounds[thread];
    if (thread == 0) {
        d.result->box = box;
        d.result->found = !box.empty() && d.state->found;
    }
}

// A block a camera.
__global__ void __launch_bounds__(kMaskThreads) result_kernel(const SegmentData* __restrict__ cameras) {
    __shared__ Scratch scratch;
    const SegmentData& d = cameras[blockIdx.z];
    const CellRange box = d.state->box;
    Measures own;
    own.x0 = d.width, own.y0 = d.height;
    if (!box.empty() && d.refine_border)
        remove_small_components({d.refined, d.width, d.cells_per_row, box}, d.min_component_px / 3, 0, {},
                                d.runs[1], scratch);
    for (int n = static_cast<int>(threadIdx.x); n < box.rows() * box.columns(); n += kMaskThreads) {
        const int y = box.y0 + n / box.columns(), k = box.k0 + n % box.columns();
        const std::size_t cell = d.cell(y, k), to = d.result_cell(y, k);
        const Word sharp = d.refined[cell], loose = d.loose[cell] | sharp;
        d.loose[cell] = loose;
        d.result_sharp[to] = sharp, d.result_loose[to] = loose;
        own.add(y, k, sharp, loose);
    }
    store_result(d, box, own);
}

}  // namespace

std::size_t run_list_size(int width, int height) {
    const std::size_t runs = static_cast<std::size_t>(width / 2 + 1) * height;
    return height + 1 + 4 * runs;
}

RunLists run_lists(int* memory, int width, int height) {
    const std::size_t runs = static_cast<std::size_t>(width / 2 + 1) * height;
    int* const first = memory + height + 1;
    return {memory, reinterpret_cast<unsigned*>(first), first + runs, first + 2 * runs, first + 3 * runs};
}

void queue_cleaning(const Stream& stream, const FrameSet& cameras, int count) {
    const dim3 masks(2, 1, static_cast<unsigned>(count));
    cleaning_kernel<<<masks, kMaskThreads, 0, stream.get()>>>(cameras.device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

void queue_results(const Stream& stream, const FrameSet& cameras, int count) {
    const dim3 grid(1, 1, static_cast<unsigned>(count));
    result_kernel<<<grid, kMaskThreads, 0, stream.get()>>>(cameras.device);
    KINEVOX_CUDA_CHECK(cudaGetLastError());
}

}  // namespace kinevox::kernels::cuda
