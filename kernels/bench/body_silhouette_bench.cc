// Silhouettes of a person of 34 capsules per second, one thread: small virtual cameras as a pose database
// uses them, and a real camera's whole image.
#include <benchmark/benchmark.h>

#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/body_silhouette.h"
#include "kernels/tests/capsule_body.h"

namespace kinevox::kernels {
namespace {

// Arguments: side of the image in px (person 0.8 of it), and whether the camera has distortion.
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
    for (auto _ : state) {
        BodyView view{&camera, mask.data(), {}};
        renderer->render(bodies[n++ % 16], std::span(&view, 1));
        benchmark::DoNotOptimize(mask.data());
    }
    state.SetItemsProcessed(state.iterations());
}
BENCHMARK(render_silhouette)
    ->ArgsProduct({{64, 96, 128, 480}, {0, 1}})
    ->ArgNames({"side", "distortion"})
    ->Unit(benchmark::kMicrosecond);

}  // namespace
}  // namespace kinevox::kernels
