// What a card's memory, bus and driver achieve.
#pragma once

#include <cstddef>

namespace card_rates {

struct Rates {
    double upload_gb_per_s = 0, download_gb_per_s = 0;  // pinned host memory
    double copy_gb_per_s = 0;                           // within the card, bytes read and written
    double launch_us = 0;                               // of the host, per queued kernel
    double kernel_us = 0;                               // per kernel of a long queue of empty ones
    double wait_us = 0;                                 // a launch and the wait for it
    double graph_us = 0;                                // a graph of ten kernels and the wait for it
};

// `gpu`: CUDA's index.
Rates measure(int gpu, std::size_t bytes, int repetitions);

}  // namespace card_rates
