#include <cuda_runtime.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <limits>

#include "tests/cuda/card_rates.h"

namespace card_rates {
namespace {

void check(cudaError_t error) {
    if (error == cudaSuccess) return;
    std::fprintf(stderr, "card_rates: %s\n", cudaGetErrorString(error));
    std::exit(1);
}

__global__ void no_work() {}

// The shortest of a few runs, s.
template <class Work>
double seconds_of(cudaStream_t stream, Work work) {
    double best = std::numeric_limits<double>::infinity();
    for (int n = 0; n < 5; ++n) {
        const auto begin = std::chrono::steady_clock::now();
        work();
        check(cudaStreamSynchronize(stream));
        best =
            std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    }
    return best;
}

void launch(cudaStream_t stream, int count) {
    for (int n = 0; n < count; ++n) no_work<<<1, 32, 0, stream>>>();
    check(cudaGetLastError());
}

double graph_seconds(cudaStream_t stream, int repetitions) {
    cudaGraph_t graph;
    cudaGraphExec_t executable;
    check(cudaStreamBeginCapture(stream, cudaStreamCaptureModeThreadLocal));
    launch(stream, 10);
    check(cudaStreamEndCapture(stream, &graph));
    check(cudaGraphInstantiate(&executable, graph, 0));
    const double seconds = seconds_of(stream, [&] {
        for (int n = 0; n < repetitions; ++n) {
            check(cudaGraphLaunch(executable, stream));
            check(cudaStreamSynchronize(stream));
        }
    });
    check(cudaGraphExecDestroy(executable));
    check(cudaGraphDestroy(graph));
    return seconds / repetitions;
}

}  // namespace

Rates measure(int gpu, std::size_t bytes, int repetitions) {
    check(cudaSetDevice(gpu));
    cudaStream_t stream;
    void *device = nullptr, *other = nullptr, *pinned = nullptr;
    check(cudaStreamCreateWithFlags(&stream, cudaStreamNonBlocking));
    check(cudaMalloc(&device, bytes));
    check(cudaMalloc(&other, bytes));
    check(cudaMallocHost(&pinned, bytes));
    const auto gb_per_s = [&](void* to, void* from, cudaMemcpyKind kind, double factor) {
        const double seconds =
            seconds_of(stream, [&] { check(cudaMemcpyAsync(to, from, bytes, kind, stream)); });
        return factor * 1e-9 * static_cast<double>(bytes) / seconds;
    };
    Rates out;
    out.upload_gb_per_s = gb_per_s(device, pinned, cudaMemcpyHostToDevice, 1);
    out.copy_gb_per_s = gb_per_s(other, device, cudaMemcpyDeviceToDevice, 2);
    out.download_gb_per_s = gb_per_s(pinned, device, cudaMemcpyDeviceToHost, 1);
    launch(stream, 1);
    check(cudaStreamSynchronize(stream));
    const auto begin = std::chrono::steady_clock::now();
    launch(stream, repetitions);
    const std::chrono::duration<double, std::micro> queued = std::chrono::steady_clock::now() - begin;
    out.launch_us = queued.count() / repetitions;
    check(cudaStreamSynchronize(stream));
    out.kernel_us = 1e6 * seconds_of(stream, [&] { launch(stream, repetitions); }) / repetitions;
    out.wait_us = 1e6 *
                  seconds_of(stream,
                             [&] {
                                 for (int n = 0; n < repetitions; ++n) {
                                     launch(stream, 1);
                                     check(cudaStreamSynchronize(stream));
                                 }
                             }) /
                  repetitions;
    out.graph_us = 1e6 * graph_seconds(stream, repetitions);
    check(cudaFree(device));
    check(cudaFree(other));
    check(cudaFreeHost(pinned));
    check(cudaStreamDestroy(stream));
    return out;
}

}  // namespace card_rates
