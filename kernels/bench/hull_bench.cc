// Visual hull: ms a frame set against voxel size, cameras and the lattice's extent. Run un-niced on a quiet
// machine:
//   kernels_bench --benchmark_filter=Hull
#include <benchmark/benchmark.h>

#include "kernels/bench/bench_device.h"
#include "kernels/bench/volume_body.h"
#include "kernels/projection.h"

namespace kinevox::kernels {
namespace {

// Arguments: voxel edge (mm), cameras, arms out (then the lattice is 2 m wide, else 1 m).
void BM_Hull(benchmark::State& state) {
    const bool arms_out = state.range(2) != 0;
    const bench::Body& body = bench::body(static_cast<int>(state.range(1)), arms_out);
    const Lattice lattice =
        bench::lattice_around(1e-3f * static_cast<float>(state.range(0)), arms_out ? 2.f : 1.f);
    const auto carver = make_hull_carver(bench::device());
    VoxelVolume volume;
    for (auto _ : state) carver->carve(body.hull_views, lattice, volume);
    state.counters["bricks"] = static_cast<double>(volume.bricks.size());
}

void BM_Projection(benchmark::State& state) {
    const bench::Body& body = bench::body(4, false);
    VoxelVolume volume;
    make_hull_carver(bench::device())->carve(body.hull_views, bench::lattice_around(0.01f, 1), volume);
    std::vector<std::uint8_t> mask(640 * 480);
    const float still[3] = {};
    Rect bounds;
    for (auto _ : state) project_volume(volume, body.cameras[0], still, 8, mask.data(), bounds);
}

BENCHMARK(BM_Hull)
    ->ArgNames({"mm", "cameras", "arms_out"})
    ->Args({20, 4, 0})
    ->Args({10, 4, 0})
    ->Args({5, 4, 0})
    ->Args({20, 4, 1})
    ->Args({10, 4, 1})
    ->Args({5, 4, 1})
    ->Args({10, 2, 0})
    ->Args({10, 8, 0})
    ->Args({10, 16, 0})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();
BENCHMARK(BM_Projection)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kinevox::kernels
