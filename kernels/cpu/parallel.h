// Data parallelism inside a stage: small tasks that idle workers steal (oneTBB), so that a busy neighbour on
// one core delays a frame by one task and not by half of it. Serial where TBB is missing. Private to
// kernels/cpu.
#pragma once

#include <algorithm>

#ifdef KINEVOX_HAVE_TBB
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#endif

namespace kinevox::kernels {

// Calls body(first, last) for consecutive pieces [begin + n * grain, ...) that together cover [begin, end),
// in any order and on any thread. The cuts depend on `grain` only, never on the number of threads, so a body
// that reduces per piece gives the same result on every machine.
template <class F>
void parallel_for(int begin, int end, int grain, F body) {
    if (end <= begin) return;
    grain = std::max(grain, 1);
    const int pieces = (end - begin + grain - 1) / grain;
    const auto piece = [&](int n) {
        const int first = begin + n * grain;
        body(first, std::min(first + grain, end));
    };
#ifdef KINEVOX_HAVE_TBB
    if (pieces > 1) {
        oneapi::tbb::parallel_for(
            oneapi::tbb::blocked_range<int>(0, pieces, 1),
            [&](const oneapi::tbb::blocked_range<int>& range) {
                for (int n = range.begin(); n != range.end(); ++n) piece(n);
            },
            oneapi::tbb::simple_partitioner());
        return;
    }
#endif
    for (int n = 0; n < pieces; ++n) piece(n);
}

}  // namespace kinevox::kernels
