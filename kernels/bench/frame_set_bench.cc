// From images to coloured volume: time of a frame set, and of each stage in it.
#include <benchmark/benchmark.h>

#include <string>
#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/bench/frame_set_rig.h"

namespace kinevox::kernels {
namespace {

// Arguments: cameras, image width and height (px), voxels along each axis of the lattice of 2 m. The number
// of iterations is fixed, since a repeated search for it would learn the background each time.
void frame_set(benchmark::State& state) {
    bench::FrameSetSize size;
    size.cameras = static_cast<int>(state.range(0));
    size.width = static_cast<int>(state.range(1));
    size.height = static_cast<int>(state.range(2));
    size.voxel_m = size.span_m / static_cast<float>(state.range(3));
    bench::FrameSetRig rig(bench::device(), size);
    for (int n = 0; n < 2; ++n) rig.run();  // grows the buffers
    bench::Samples total, segmentation("segmentation"), hull("hull"), colouring("colouring");
    for (auto _ : state) {
        const bench::StageTimes times = rig.run();
        segmentation.add_ms(times.segmentation_ms);
        if (times.hull_ms > 0) hull.add_ms(times.hull_ms);
        colouring.add_ms(times.colouring_ms);
        total.add_ms(times.segmentation_ms + times.hull_ms + times.colouring_ms);
    }
    for (bench::Samples* samples : {&total, &segmentation, &hull, &colouring}) samples->report(state);
    state.counters["surface"] = static_cast<double>(rig.volume().colours.size());
}
const std::vector<std::string> kArguments = {"cameras", "width", "height", "voxels"};
BENCHMARK(frame_set)  // for a run without a GPU
    ->ArgNames(kArguments)
    ->Args({2, 160, 120, 80})
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK(frame_set)
    ->ArgNames(kArguments)
    ->Args({4, 640, 480, 128})
    ->Args({4, 640, 480, 200})
    ->Args({4, 640, 480, 256})
    ->Args({4, 640, 480, 384})
    ->Args({4, 640, 480, 512})
    ->Args({8, 1920, 1080, 256})
    ->Args({16, 1920, 1080, 256})
    ->Iterations(100)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace kinevox::kernels
