// Voxel colouring: ms a frame set, the hull apart.
//   kernels_bench --benchmark_filter=Colouring
#include <benchmark/benchmark.h>

#include "kernels/bench/bench_device.h"
#include "kernels/bench/volume_body.h"

namespace kinevox::kernels {
namespace {

// Arguments: voxel edge (mm), cameras, rounds of carving.
void BM_Colouring(benchmark::State& state) {
    const bench::Body& body = bench::body(static_cast<int>(state.range(1)), false);
    const Lattice lattice = bench::lattice_around(1e-3f * static_cast<float>(state.range(0)), 1.f);
    VoxelVolume hull, volume;
    make_hull_carver(bench::device())->carve(body.hull_views, lattice, hull);
    ColouringOptions options;
    options.max_rounds = static_cast<int>(state.range(2));
    const auto colourer = make_voxel_colourer(bench::device(), options);
    ColouringReport report;
    for (auto _ : state) {
        volume = hull;
        colourer->colour(body.colouring_views, volume, report);
    }
    state.counters["surface"] = static_cast<double>(volume.colours.size());
    state.counters["carved"] = static_cast<double>(report.carved);
}

const int kRounds = ColouringOptions{}.max_rounds;

BENCHMARK(BM_Colouring)
    ->ArgNames({"mm", "cameras", "rounds"})
    ->Args({20, 4, kRounds})
    ->Args({10, 4, kRounds})
    ->Args({5, 4, kRounds})
    ->Args({10, 4, 0})
    ->Args({10, 4, 1})
    ->Args({10, 2, kRounds})
    ->Args({10, 8, kRounds})
    ->Args({10, 16, kRounds})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace kinevox::kernels
