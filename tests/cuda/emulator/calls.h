// What a program asked of the runtime, for tests/cuda/frame_set_calls.cc.
#pragma once

#include <cstddef>

namespace cuda_emulator {

struct Calls {
    long launches = 0, uploads = 0, downloads = 0, memsets = 0, waits = 0, allocations = 0;
    std::size_t uploaded_bytes = 0, downloaded_bytes = 0;
};

// Since the last call.
Calls take_calls();

}  // namespace cuda_emulator
