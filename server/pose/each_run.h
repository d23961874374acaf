// Runs of consecutive frame sets.
#pragma once

#include <cstddef>

namespace kinevox {

// Calls run(first, end) for each run of frame sets that `holds` is true of.
template <typename Holds, typename Run>
void each_run(std::size_t count, const Holds& holds, const Run& run) {
    for (std::size_t first = 0, end; first < count; first = end + 1) {
        for (end = first; end < count && holds(end);) ++end;
        if (end > first) run(first, end);
    }
}

}  // namespace kinevox
