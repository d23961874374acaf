// Results of every stage in its CPU and CUDA form: how many values differ, and a hash of each. The CUDA
// form's must be the same on a GPU and on the emulator, in every order of threads. usage: cuda_results [WIDTH
// HEIGHT VOXEL_MM FRAMES]     default: 160 120 25 4 Prints STAGE VALUES DIFFERENT CPU_HASH CUDA_HASH,
// tab-separated. Exit status: 1 if a stage without tolerance differs.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <map>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "kernels/bench/frame_set_rig.h"
#include "kernels/body_silhouette.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/moments.h"
#include "kernels/segmentation.h"
#include "kernels/tests/capsule_body.h"
#include "kernels/tests/segmentation_scene.h"
#include "kernels/tests/volume_scene.h"

namespace kinevox::kernels {
namespace {

struct Size {
    int width = 160, height = 120, frames = 4;
    float voxel_m = 0.025f;
};

std::uint64_t fnv1a(std::uint64_t hash, const void* memory, std::size_t bytes) {
    const auto* byte = static_cast<const std::uint8_t*>(memory);
    for (std::size_t n = 0; n < bytes; ++n) hash = (hash ^ byte[n]) * 1099511628211u;
    return hash;
}
constexpr std::uint64_t kEmptyHash = 14695981039346656037u;

// Values of one stage from one device, in order, each as a hash.
struct Results {
    std::vector<std::uint64_t> values;

    template <class T>
    void add(const T& value) {
        values.push_back(fnv1a(kEmptyHash, &value, sizeof value));
    }
    template <class T>
    void add_each(const std::vector<T>& list) {
        for (const T& value : list) add(value);
    }
    std::uint64_t hash() const {
        return fnv1a(kEmptyHash, values.data(), values.size() * sizeof(std::uint64_t));
    }
};

std::size_t different(const Results& a, const Results& b) {
    const std::size_t common = std::min(a.values.size(), b.values.size());
    std::size_t count = std::max(a.values.size(), b.values.size()) - common;
    for (std::size_t n = 0; n < common; ++n) count += a.values[n] != b.values[n];
    return count;
}

Results segmentation(Device device, const Size& size, int channels) {
    testing::TestRoom room(size.width, size.height, channels, 5);
    SegmentationOptions options;
    options.update_interval = 2;  // so that a few frames update every row
    const auto segmenter = make_segmenter(device, size.width, size.height, channels, options);
    const auto clip = room.clip(12);
    segmenter->learn(testing::views_of(clip));
    Results out;
    const int width = size.width, height = size.height;
    std::vector<std::uint8_t> expected(static_cast<std::size_t>(width) * height);
    for (int frame = 0; frame < size.frames; ++frame) {
        auto image = room.image(1 + 0.02 * (frame % 3));
        const int x = width / 3 + 7 * frame, y = height / 4;
        room.shade(image, {x - 20, y + height / 3, std::min(x + width / 4, width), y + height / 2}, 0.7);
        room.draw(image, {x, y, x + width / 9, y + height / 2}, 40, 60, 150);
        room.draw(image, {x + 5, y + 30, x + 11, y + 37}, 100, 100, 100);
        SegmentationPrior prior;
        std::fill(expected.begin(), expected.end(), std::uint8_t{0});
        if (frame > 1) {
            prior.region = {x - 60, y - 40, x + width / 4, y + height / 2 + 40};
            prior.full_pass = frame % 4 == 0;
            for (int row = y; row < y + height / 2; ++row)
                std::fill_n(expected.begin() + static_cast<std::ptrdiff_t>(row) * width + x, width / 9,
                            std::uint8_t{255});
            prior.expected = expected.data();
        }
        Silhouettes silhouettes;
        segmenter->segment(image.view(), prior, silhouettes);
        out.add_each(silhouettes.probability);
        out.add_each(silhouettes.sharp);
        out.add_each(silhouettes.loose);
        out.add(silhouettes.sharp_pixels);
        out.add(silhouettes.centroid_x);
        out.add(silhouettes.centroid_y);
        out.add(silhouettes.bounds);
    }
    return out;
}

void add_volume(Results& out, const VoxelVolume& volume) {
    for (const Brick& brick : volume.bricks) {
        out.add(std::tuple(brick.x, brick.y, brick.z));
        for (const std::uint64_t slice : brick.occupancy) out.add(slice);
    }
}

// A ball on a box, with a patterned surface.
const testing::Scene& body_in_ring(int cameras, const Size& size) {
    static std::map<int, testing::Scene> scenes;  // one size per run; drawing takes a while
    testing::Scene& scene = scenes[cameras];
    if (!scene.cameras.empty()) return scene;
    scene = testing::ring_of_cameras(cameras, -0.05f, 0.01f, 0.0003f);
    for (CameraModel& camera : scene.cameras) {
        const float scale = static_cast<float>(size.width) / static_cast<float>(camera.width);
        camera.width = size.width;
        camera.height = size.height;
        camera.fx *= scale;
        camera.fy *= scale;
        camera.cx = 0.5f * static_cast<float>(size.width - 1);
        camera.cy = 0.5f * static_cast<float>(size.height - 1);
    }
    const auto body = [](const float* p) {
        return std::min(testing::box_distance(p, 0.12f, 0.2f, 0.3f),
                        testing::sphere_distance(p, 0.2f, 0.1f, 1.1f, 0.2f));
    };
    const auto paint = [](const float* p) {
        const auto square = [](float x) { return static_cast<int>(std::floor(x / 0.07f)); };
        return (square(p[0]) + square(p[1]) + square(p[2])) % 2 ? Colour{200, 80, 30} : Colour{40, 90, 180};
    };
    scene.draw(body, paint);
    return scene;
}

Lattice lattice_of(const Size& size) {
    const int edge = static_cast<int>(1.2f / size.voxel_m / kBrickEdge) * kBrickEdge;
    return testing::make_lattice(size.voxel_m, edge, edge, edge + kBrickEdge);
}

Results hull(Device device, const Size& size, float budget_permille) {
    const testing::Scene& scene = body_in_ring(4, size);
    HullOptions options;
    options.miss_budget_permille = budget_permille;
    VoxelVolume volume;
    make_hull_carver(device, options)->carve(scene.hull_views(), lattice_of(size), volume);
    Results out;
    add_volume(out, volume);
    return out;
}

// From the CPU's hull, so that only this stage's differences count.
Results colouring(Device device, const Size& size, float budget_permille) {
    const testing::Scene& scene = body_in_ring(5, size);
    HullOptions options;
    options.miss_budget_permille = budget_permille;
    VoxelVolume volume;
    make_hull_carver(Device::kCpu, options)->carve(scene.hull_views(), lattice_of(size), volume);
    ColouringReport report;
    make_voxel_colourer(device)->colour(scene.colouring_views(), volume, report);
    Results out;
    add_volume(out, volume);
    out.add_each(volume.colours);
    out.add_each(report.silhouette_iou);
    return out;
}

// All stages, from images to coloured volumes: what one leaves on the device the next one reads there.
Results frame_sets(Device device, const Size& size) {
    bench::FrameSetSize rig_size;
    rig_size.width = size.width, rig_size.height = size.height;
    rig_size.voxel_m = size.voxel_m;
    bench::FrameSetRig rig(device, rig_size);
    Results out;
    for (int frame = 0; frame < size.frames; ++frame) {
        rig.run();
        add_volume(out, rig.volume());
        out.add_each(rig.volume().colours);
    }
    return out;
}

std::vector<CameraModel> cameras_around(const Size& size) {
    std::vector<CameraModel> cameras;
    for (int n = 0; n < 4; ++n) {
        const float angle = 1.6f * static_cast<float>(n), at[3] = {0, 0, 0.9f};
        const float from[3] = {4 * std::cos(angle), 4 * std::sin(angle), 1.4f};
        const float focal_px = 0.94f * static_cast<float>(size.width);
        cameras.push_back(testing::camera_looking(from, at, size.width, size.height, focal_px));
        cameras.back().k1 = n % 2 ? -0.1f : 0;
    }
    return cameras;
}

Results body_silhouettes(Device device, const Size& size) {
    const auto cameras = cameras_around(size);
    const auto person = testing::capsule_person(0, 0, 0.4f, 0.3f);
    Results out;
    for (const CameraModel& camera : cameras) {
        std::vector<std::uint8_t> mask(static_cast<std::size_t>(size.width) * size.height);
        BodyView view{&camera, mask.data(), {}};
        make_body_silhouette_renderer(device)->render(person, std::span(&view, 1));
        out.add_each(mask);
        out.add(view.bounds);
    }
    return out;
}

Results moments(Device device, const Size& size) {
    const auto cameras = cameras_around(size);
    const auto person = testing::capsule_person(0, 0, 0.4f, 0.3f);
    std::vector<std::vector<std::uint8_t>> masks(cameras.size());
    std::vector<MomentView> views;
    for (std::size_t n = 0; n < cameras.size(); ++n) {
        masks[n].resize(static_cast<std::size_t>(size.width) * size.height);
        BodyView view{&cameras[n], masks[n].data(), {}};
        make_body_silhouette_renderer(Device::kCpu)->render(person, std::span(&view, 1));
        views.push_back({masks[n].data(), size.width, view.bounds, {}});
    }
    std::vector<SilhouetteMoments> computed;
    make_moment_calculator(device)->compute(views, computed);
    Results out;
    for (const SilhouetteMoments& one : computed) {
        out.add(one.mass_px);
        out.add_each(one.values);
    }
    return out;
}

// Prints a stage's row; false if more than `allowed` of its values differ.
template <class Stage>
bool compare(const char* name, Device gpu, double allowed, Stage stage) {
    const Results cpu = stage(Device::kCpu), cuda = stage(gpu);
    const std::size_t count = cuda.values.size(), differ = different(cpu, cuda);
    std::printf("%s\t%zu\t%zu\t%016llx\t%016llx\n", name, count, differ,
                static_cast<unsigned long long>(cpu.hash()), static_cast<unsigned long long>(cuda.hash()));
    std::fflush(stdout);
    return static_cast<double>(differ) <= allowed * static_cast<double>(count);
}

bool compare_all(Device gpu, const Size& size) {
    bool same = true;
    same &= compare("segmentation, colour", gpu, 0.002, [&](Device d) { return segmentation(d, size, 3); });
    same &= compare("segmentation, grey", gpu, 0.002, [&](Device d) { return segmentation(d, size, 1); });
    same &= compare("hull", gpu, 0.0005, [&](Device d) { return hull(d, size, 0); });
    same &= compare("hull with a budget", gpu, 0.0005, [&](Device d) { return hull(d, size, 5); });
    same &= compare("colouring", gpu, 0.0005, [&](Device d) { return colouring(d, size, 0); });
    same &= compare("colouring with a budget", gpu, 0.0005, [&](Device d) { return colouring(d, size, 5); });
    same &= compare("frame sets", gpu, 0.0005, [&](Device d) { return frame_sets(d, size); });
    // The CPU draws polygons and sums in another order.
    same &= compare("body silhouettes", gpu, 0.001, [&](Device d) { return body_silhouettes(d, size); });
    same &= compare("moments", gpu, 1, [&](Device d) { return moments(d, size); });
    return same;
}

}  // namespace
}  // namespace kinevox::kernels

int main(int argc, char** argv) {
    using namespace kinevox::kernels;
    Size size;
    Device gpu = Device::kCuda;
    if (argc == 5 || argc == 6) {
        size = {std::atoi(argv[1]), std::atoi(argv[2]), std::atoi(argv[4]),
                1e-3f * static_cast<float>(std::atof(argv[3]))};
        gpu = argc == 6 ? device_of_name(argv[5]).value_or(Device::kCpu) : gpu;
    }
    if ((argc != 1 && argc != 5 && argc != 6) || !gpu.is_cuda()) {
        std::fprintf(stderr, "usage: cuda_results [WIDTH HEIGHT VOXEL_MM FRAMES [cuda:N]]\n");
        return 2;
    }
    try {
        return compare_all(gpu, size) ? 0 : 1;
    } catch (const std::exception& error) {
        std::fprintf(stderr, "cuda_results: %s\n", error.what());
        return 1;
    }
}
