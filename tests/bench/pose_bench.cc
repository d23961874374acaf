// What a fit costs: reading a silhouette, one linearisation of the cost, a whole fit, and searches of limbs.
#include <benchmark/benchmark.h>

#include <random>
#include <vector>

#include "common/geometry.h"
#include "server/pose/limb_search.h"
#include "server/pose/pose_fitter.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

// The standing body, `degrees` off in every joint.
BodyPosture perturbed(const testing::SeenBody& scene, double degrees) {
    std::mt19937 random(7);
    std::uniform_real_distribution<> unit(-1, 1);
    BodyCoordinates q = scene.standing();
    for (int k = 0; k < kBodyDofCount; ++k) q[k] += unit(random) * (is_position(k) ? 0.01 : radians(degrees));
    return posture_from_coordinates(q);
}

testing::SeenBody seen_by(int cameras) {
    testing::SeenBody scene;
    scene.cameras = testing::camera_ring(cameras);
    return scene;
}

void read_view(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(4);
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(scene.standing()), capsules);
    const kernels::Silhouettes silhouettes = testing::silhouette_of(scene.cameras[0], capsules);
    SilhouetteRays view;
    for (auto _ : state) read_silhouette(scene.cameras[0], silhouettes, {}, view);
    state.counters["rays"] = static_cast<double>(view.contour.size());
}

// Argument: number of cameras.
void linearise(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const BodyPosture posture = perturbed(scene, 6);
    PoseCost cost;
    Linearisation out;
    for (auto _ : state) cost.linearise(*scene.model, posture, views, nullptr, 0.04, out);
    state.counters["cost"] = out.cost;
}

void fit(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const BodyPosture posture = perturbed(scene, 6);
    PoseFitter fitter;
    for (auto _ : state) benchmark::DoNotOptimize(fitter.fit(*scene.model, views, posture, nullptr, true));
}

void search_limb(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const BodyPosture posture = perturbed(scene, 6);
    LimbSearch search;
    for (auto _ : state)
        benchmark::DoNotOptimize(
            search.improve(*scene.model, posture, views, Limb::kArmL, LimbSearchScope::kWhole, 0.08));
}

void search_pair(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const BodyPosture posture = perturbed(scene, 6);
    LimbSearch search;
    for (auto _ : state)
        benchmark::DoNotOptimize(
            search.improve_pair(*scene.model, posture, views, Limb::kArmL, Limb::kArmR, 0.08));
}

BENCHMARK(read_view)->Unit(benchmark::kMicrosecond);
BENCHMARK(linearise)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK(fit)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK(search_limb)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK(search_pair)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);

}  // namespace
}  // namespace kinevox
