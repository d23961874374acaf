// A body model's silhouettes and the moments of silhouettes, as the pose database compares them.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <span>
#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/body_silhouette.h"
#include "kernels/moments.h"
#include "kernels/tests/capsule_body.h"
#include "kernels/tests/moment_shapes.h"

namespace kinevox::kernels {
namespace {

// Silhouettes of a person of 34 capsules per second, one thread: small virtual cameras as a pose database
// uses them, and a real camera's whole image. Arguments: side of the image in px (person 0.8 of it), and
// whether the camera has distortion.
void render_silhouette(benchmark::State& state) {
    const int side = static_cast<int>(state.range(0));
    const float from[3] = {3.0f, -2.2f, 1.4f}, at[3] = {0, 0, 0.9f};
    CameraModel camera = testing::camera_looking(from, at, side, side, 1.7f * static_cast<float>(side));
    if (state.range(1)) camera.k1 = -0.1f;
    std::vector<std::vector<TaperedCapsule>> bodies;
    for (int n = 0; n < 16; ++n) bodies.push_back(testing::capsule_person(0, 0, 0.4f * n, 0.1f * n - 0.8f));
    std::vector<std::uint8_t> mask(static_cast<std::size_t>(side) * side);
    auto renderer = make_body_silhouette_renderer(bench::device());
    int n = 0;
    bench::Samples samples;
    for (auto _ : state) {
        BodyView view{&camera, mask.data(), {}};
        samples.time([&] { renderer->render(bodies[n++ % 16], std::span(&view, 1)); });
        benchmark::DoNotOptimize(mask.data());
    }
    samples.report(state);
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(render_silhouette)
    ->ArgsProduct({{64, 96, 128, 480}, {0, 1}})
    ->ArgNames({"side", "distortion"})
    ->Unit(benchmark::kMicrosecond);

// As the pipeline computes them: images of 640 x 480, a person 300 px tall in each.
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
    bench::Samples samples;
    for (auto _ : state) {
        samples.time([&] { calculator->compute(views, out); });
        benchmark::DoNotOptimize(out.data());
    }
    samples.report(state);
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
