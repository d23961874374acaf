// Replaces oneTBB's header of this name under ThreadSanitizer, which does not see how Debian's oneTBB passes
// work between threads: the same loops on standard threads, so that races of the loop bodies are found, among
// each other and with the code before and after them.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <type_traits>

#include "loop_crew.h"

namespace kinevox::sanitize {

inline constexpr std::size_t kThreads = 3;  // per loop, including the caller's

// Calls one_piece(n) for each n below `pieces`, in any order, on any of the threads. Rethrows an exception of
// a piece when all have ended.
template <class F>
void share_out(std::size_t pieces, const F& one_piece) {
    std::atomic<std::size_t> next = 0;
    // Relaxed, so that the sanitizer sees no ordering between pieces.
    const auto work = [&] {
        for (auto n = next.fetch_add(1, std::memory_order_relaxed); n < pieces;
             n = next.fetch_add(1, std::memory_order_relaxed))
            one_piece(n);
    };
    if (pieces < 2) return work();
    LoopCrew::Loop loop{.work = work, .wanted = std::min(kThreads, pieces) - 1};
    loop_crew().invite(loop);
    try {
        work();
    } catch (...) {
        loop_crew().close(loop);
        throw;
    }
    loop_crew().close(loop);
    if (loop.thrown) std::rethrow_exception(loop.thrown);
}

}  // namespace kinevox::sanitize

namespace tbb {

template <class Index, class F, class... Partitioner>
requires std::is_integral_v<Index>
void parallel_for(Index begin, std::type_identity_t<Index> end, const F& body, Partitioner&&...) {
    if (begin < end)
        kinevox::sanitize::share_out(static_cast<std::size_t>(end - begin), [&](std::size_t n) {
            body(static_cast<Index>(begin + static_cast<Index>(n)));
        });
}

template <class Range, class F, class... Partitioner>
requires(!std::is_integral_v<Range>) void parallel_for(const Range& range, const F& body, Partitioner&&...) {
    const std::size_t size = range.size(), grain = range.grainsize();
    kinevox::sanitize::share_out((size + grain - 1) / grain, [&](std::size_t n) {
        const auto first = range.begin() + n * grain;
        body(Range(first, first + std::min(grain, size - n * grain), grain));
    });
}

}  // namespace tbb
