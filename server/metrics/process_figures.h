// What the kernel says of this process.
#pragma once

#include <cstdint>

namespace kinevox::metrics {

struct ProcessFigures {
    std::uint64_t resident_bytes = 0;
    double processor_s = 0;  // of all threads
    int open_files = 0;
    std::uint64_t open_files_limit = 0;
};

// What cannot be read is 0.
ProcessFigures process_figures();

}  // namespace kinevox::metrics
