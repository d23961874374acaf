// What a fit costs: reading a silhouette, one linearisation of the cost, a whole fit, and searches of arms
// and limbs.
#include <benchmark/benchmark.h>

#include <array>
#include <random>
#include <vector>

#include "common/geometry.h"
#include "server/pose/arm_search.h"
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

// As in each live frame set, with a colour in each cell.
void move_arm(benchmark::State& state) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    std::vector<SilhouetteRays> views = scene.see(scene.standing());
    std::vector<BodyCapsule> capsules;
    scene.model->capsules(scene.model->forward(scene.standing()), capsules);
    std::mt19937 random(7);
    for (std::size_t c = 0; c < views.size(); ++c) {
        const kernels::Silhouettes silhouettes = testing::silhouette_of(scene.cameras[c], capsules);
        std::vector<std::uint8_t> noise(3ull * silhouettes.width * silhouettes.height);
        for (std::uint8_t& value : noise) value = static_cast<std::uint8_t>(random());
        read_colours({noise.data(), silhouettes.width, silhouettes.height, 3, 3 * silhouettes.width},
                     silhouettes, SilhouetteRayOptions().colour_side, views[c].colours);
    }
    BodyColours colours;
    colours.add(views, capsules);
    for (auto _ : state) {
        ArmSearch search(*scene.model, posture_from_coordinates(scene.standing()), Limb::kArmL, views,
                         colours, PoseFitOptions{});
        search.improve(std::array{0.3}, 1);
        benchmark::DoNotOptimize(search.around(0.6));
    }
}

// `search` of a LimbSearch from a perturbed posture.
template <typename Search>
void search(benchmark::State& state, const Search& search) {
    const testing::SeenBody scene = seen_by(static_cast<int>(state.range(0)));
    const std::vector<SilhouetteRays> views = scene.see(scene.standing());
    const BodyPosture posture = perturbed(scene, 6);
    LimbSearch limbs;
    for (auto _ : state) benchmark::DoNotOptimize(search(limbs, *scene.model, posture, views));
}
constexpr double kRobust_m = 0.08;
constexpr auto kOneLimb = [](LimbSearch& limbs, auto&&... scene) {
    return limbs.improve(scene..., Limb::kArmL, LimbSearchScope::kWhole, kRobust_m);
};
constexpr auto kPair = [](LimbSearch& limbs, auto&&... scene) {
    return limbs.improve_pair(scene..., Limb::kArmL, Limb::kArmR, kRobust_m);
};

BENCHMARK(read_view)->Unit(benchmark::kMicrosecond);
BENCHMARK(linearise)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK(fit)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK(move_arm)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK_CAPTURE(search, limb, kOneLimb)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);
BENCHMARK_CAPTURE(search, pair, kPair)->Unit(benchmark::kMicrosecond)->ArgName("cameras")->Arg(4)->Arg(8);

}  // namespace
}  // namespace kinevox
