// Moments of four silhouettes as the pipeline computes them: images of 640 x 480, a person 300 px tall in
// each.
#include <benchmark/benchmark.h>

#include <memory>
#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/moments.h"
#include "kernels/tests/moment_shapes.h"

namespace kinevox::kernels {
namespace {

void moments_of_four_silhouettes(benchmark::State& state) {
    constexpr int kCameras = 4;
    std::vector<testing::ShapeMask> masks;
    std::vector<MomentView> views;
    for (int n = 0; n < kCameras; ++n)
        masks.push_back(testing::draw_figure(640, 480, 250 + 40 * n, 240, 150, 0.2 * n));
    for (const auto& mask : masks) {
        views.push_back(mask.view());
        Rect& box = views.back().bounds;
        box = {640, 480, 0, 0};
        for (int y = 0; y < 480; ++y)
            for (int x = 0; x < 640; ++x)
                if (mask.pixels[y * 640 + x]) {
                    box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1),
                           std::max(box.y1, y + 1)};
                }
    }
    auto calculator = make_moment_calculator(bench::device(), {.order = static_cast<int>(state.range(0)),
                                                               .grid = static_cast<int>(state.range(1))});
    std::vector<SilhouetteMoments> out;
    for (auto _ : state) {
        calculator->compute(views, out);
        benchmark::DoNotOptimize(out.data());
    }
}
BENCHMARK(moments_of_four_silhouettes)
    ->ArgsProduct({{6, 10, 20}, {32, 64, 128}})
    ->ArgNames({"order", "grid"})
    ->Unit(benchmark::kMicrosecond);

void moment_tables_made(benchmark::State& state) {
    int grid = 16;  // another one each time: tables are kept
    for (auto _ : state) {
        benchmark::DoNotOptimize(make_moment_calculator(bench::device(), {.order = 10, .grid = grid}));
        grid = grid == 256 ? 16 : grid + 16;
    }
}
BENCHMARK(moment_tables_made)->Unit(benchmark::kMillisecond)->Iterations(16);

}  // namespace
}  // namespace kinevox::kernels
