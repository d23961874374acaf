// Visual hull and voxel colouring of a person-sized body seen by a ring of cameras: ms a frame set against
// voxel size, cameras and the lattice's extent; colouring without the hull. Run un-niced on a quiet machine:
//   kernels_bench --benchmark_filter='Hull|Colouring'
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/projection.h"
#include "kernels/tests/volume_scene.h"

namespace kinevox::kernels {
namespace {

struct Body {
    std::vector<CameraModel> cameras;  // 640 x 480 px
    std::vector<std::vector<std::uint8_t>> masks, images;
    std::vector<HullView> hull_views;
    std::vector<ColouringView> colouring_views;
};

struct Capsule {
    float from[3], to[3], radius;
};

float distance_to(const Capsule& c, const float* p) {
    float along[3], offset[3], dot = 0, length = 0;
    for (int axis = 0; axis < 3; ++axis) {
        along[axis] = c.to[axis] - c.from[axis];
        offset[axis] = p[axis] - c.from[axis];
        dot += along[axis] * offset[axis];
        length += along[axis] * along[axis];
    }
    const float at = std::clamp(dot / length, 0.f, 1.f);
    for (int axis = 0; axis < 3; ++axis) offset[axis] -= at * along[axis];
    return std::hypot(offset[0], offset[1], offset[2]) - c.radius;
}

Body make_body(int cameras, bool arms_out) {
    std::vector<Capsule> parts = {{{0, 0, 0.95f}, {0, 0, 1.40f}, 0.16f},
                                  {{0, 0, 1.62f}, {0, 0, 1.70f}, 0.10f},
                                  {{0, 0, 1.4f}, {0, 0, 1.6f}, 0.06f},
                                  {{0, 0.10f, 0.95f}, {0.15f, 0.12f, 0.50f}, 0.085f},
                                  {{0.15f, 0.12f, 0.5f}, {0, 0.12f, 0.08f}, 0.06f},
                                  {{0, -0.10f, 0.95f}, {-0.1f, -0.12f, 0.5f}, 0.085f},
                                  {{-0.1f, -0.12f, 0.5f}, {-0.25f, -0.12f, 0.1f}, 0.06f}};
    for (const float side : {-1.f, 1.f}) {
        const float hand_y = arms_out ? 0.85f : 0.3f, low = arms_out ? 1.42f : 0.85f;
        parts.push_back({{0, side * 0.18f, 1.40f}, {0.05f, side * hand_y, low}, 0.045f});
    }
    const auto person = [&](const float* p) {
        float nearest = 10;
        for (const Capsule& part : parts) nearest = std::min(nearest, distance_to(part, p));
        return nearest;
    };
    const auto stripes = [](const float* p) {
        const bool light = static_cast<int>(std::floor(p[2] / 0.07f)) % 2 == 0;
        return light ? Colour{210, 200, 180} : Colour{120, 40, 50};
    };
    Body body;
    testing::Scene scene = testing::ring_of_cameras(cameras, 0, 0, 0);
    for (int n = 0; n < cameras; ++n) {  // all of one size, 5 m away
        CameraModel& c = scene.cameras[n];
        c.width = 640, c.height = 480, c.fx = c.fy = 620, c.cx = 319.5f, c.cy = 239.5f;
        c.translation_camera_from_world[2] += 2;
    }
    scene.draw(person, stripes, {90, 100, 110});
    body.cameras = scene.cameras;
    body.masks = std::move(scene.masks);
    body.images = std::move(scene.images);
    return body;
}

// Capsules for trunk, head, legs and arms (arms out: a lattice of 2 x 2 x 2 m is needed), patterned.
const Body& body(int cameras, bool arms_out) {
    static std::map<std::pair<int, bool>, Body> made;  // drawing takes a while
    const auto [found, is_new] = made.try_emplace({cameras, arms_out});
    Body& body = found->second;
    if (is_new) {
        body = make_body(cameras, arms_out);
        testing::Scene scene{body.cameras, body.masks, body.images};
        const auto hull = scene.hull_views();
        for (int n = 0; n < cameras; ++n) {
            const CameraModel& c = body.cameras[n];
            const std::uint8_t* mask = body.masks[n].data();
            body.hull_views.push_back({&c, mask, hull[n].bounds});
            ColouringView view;
            view.camera = &c;
            view.image = {body.images[n].data(), c.width, c.height, 3, 3 * c.width};
            view.silhouette = view.sharp = mask;
            view.bounds = hull[n].bounds;
            body.colouring_views.push_back(view);
        }
    }
    return body;
}

// Around the body, `span_m` wide and deep and 2 m high.
Lattice lattice_around(float voxel_m, float span_m) {
    Lattice lattice;
    lattice.voxel_m = voxel_m;
    const float span[3] = {span_m, span_m, 2};
    for (int axis = 0; axis < 3; ++axis) {
        lattice.size[axis] = static_cast<int>(std::ceil(span[axis] / voxel_m / kBrickEdge)) * kBrickEdge;
        lattice.origin[axis] = axis == 2 ? -0.05f : -0.5f * voxel_m * static_cast<float>(lattice.size[axis]);
    }
    return lattice;
}

// Arguments: voxel edge (mm), cameras, rounds of carving.
void BM_Colouring(benchmark::State& state) {
    const Body& person = body(static_cast<int>(state.range(1)), false);
    const Lattice lattice = lattice_around(1e-3f * static_cast<float>(state.range(0)), 1.f);
    VoxelVolume hull, volume;
    make_hull_carver(bench::device())->carve(person.hull_views, lattice, hull);
    ColouringOptions options;
    options.max_rounds = static_cast<int>(state.range(2));
    const auto colourer = make_voxel_colourer(bench::device(), options);
    ColouringReport report;
    bench::Samples samples;
    for (auto _ : state) {
        samples.time([&] {
            volume = hull;
            colourer->colour(person.colouring_views, volume, report);
        });
    }
    samples.report(state);
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

// Arguments: voxel edge (mm), cameras, arms out (then the lattice is 2 m wide, else 1 m).
void BM_Hull(benchmark::State& state) {
    const bool arms_out = state.range(2) != 0;
    const Body& person = body(static_cast<int>(state.range(1)), arms_out);
    const Lattice lattice = lattice_around(1e-3f * static_cast<float>(state.range(0)), arms_out ? 2.f : 1.f);
    const auto carver = make_hull_carver(bench::device());
    VoxelVolume volume;
    bench::Samples samples;
    for (auto _ : state) samples.time([&] { carver->carve(person.hull_views, lattice, volume); });
    samples.report(state);
    state.counters["bricks"] = static_cast<double>(volume.bricks.size());
}

void BM_Projection(benchmark::State& state) {
    const Body& person = body(4, false);
    VoxelVolume volume;
    make_hull_carver(bench::device())->carve(person.hull_views, lattice_around(0.01f, 1), volume);
    std::vector<std::uint8_t> mask(640 * 480);
    const float still[3] = {};
    Rect bounds;
    bench::Samples samples;
    for (auto _ : state)
        samples.time([&] { project_volume(volume, person.cameras[0], still, 8, mask.data(), bounds); });
    samples.report(state);
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
