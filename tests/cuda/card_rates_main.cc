// usage: card_rates [MEGABYTES REPETITIONS [GPU]]     default: 256 500 0; prints NAME VALUE UNIT,
// tab-separated
#include <cstdio>
#include <cstdlib>

#include "tests/cuda/card_rates.h"

int main(int argc, char** argv) {
    const int megabytes = argc > 2 ? std::atoi(argv[1]) : 256,
              repetitions = argc > 2 ? std::atoi(argv[2]) : 500, gpu = argc > 3 ? std::atoi(argv[3]) : 0;
    const card_rates::Rates rates =
        card_rates::measure(gpu, static_cast<std::size_t>(megabytes) << 20, repetitions);
    std::printf("upload, pinned\t%.1f\tGB/s\n", rates.upload_gb_per_s);
    std::printf("download, pinned\t%.1f\tGB/s\n", rates.download_gb_per_s);
    std::printf("copy within the card\t%.0f\tGB/s\n", rates.copy_gb_per_s);
    std::printf("queueing a kernel\t%.1f\tus\n", rates.launch_us);
    std::printf("empty kernel in a queue\t%.1f\tus\n", rates.kernel_us);
    std::printf("launch and wait\t%.1f\tus\n", rates.wait_us);
    std::printf("graph of ten kernels and wait\t%.1f\tus\n", rates.graph_us);
    return 0;
}
