#include "server/pipeline/tracking/scene_lattice.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "server/pipeline/tracking/cone_box.h"

namespace kinevox {
namespace {

constexpr double kCell_m = 0.04, kMaxSide_m = 14, kTo_m = 2.56;

struct ObservedSpace {
    Box3 box;
    Vec3 middle;  // of what the most cameras see
};

// Where a person can be: seen by enough cameras at chest height.
ObservedSpace observed_space(const std::vector<Camera>& cameras) {
    constexpr double kStep_m = 0.25, kChest_m = 1.1, kRange_m = 15;
    const std::size_t needed = std::min<std::size_t>(cameras.size(), 3);
    Vec3 middle;
    for (const Camera& camera : cameras) middle += camera.centre_in_world() / double(cameras.size());
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Box3 box{{kFar, kFar, kSceneFloor_m}, {-kFar, -kFar, kTo_m}};
    Vec3 sum;  // of the points that the most cameras see
    std::ptrdiff_t points = 0, max_views = 0;
    for (double y = middle.y - kRange_m; y <= middle.y + kRange_m; y += kStep_m)
        for (double x = middle.x - kRange_m; x <= middle.x + kRange_m; x += kStep_m) {
            const auto views = std::ranges::count_if(cameras, [&](const Camera& camera) {
                return shows(camera, {x, y, kChest_m});
            });
            if (static_cast<std::size_t>(views) < needed) continue;
            if (views > max_views) sum = {}, points = 0, max_views = views;
            if (views == max_views) sum += Vec3{x, y, kChest_m}, ++points;
            box.min_in_world = {std::min(box.min_in_world.x, x), std::min(box.min_in_world.y, y),
                                kSceneFloor_m};
            box.max_in_world = {std::max(box.max_in_world.x, x), std::max(box.max_in_world.y, y), kTo_m};
        }
    if (points == 0)
        return {{{middle.x - 2, middle.y - 2, kSceneFloor_m}, {middle.x + 2, middle.y + 2, kTo_m}}, middle};
    return {box, sum / static_cast<double>(points)};
}

}  // namespace

kernels::Lattice scene_lattice(const std::vector<Camera>& cameras) {
    const ObservedSpace space = observed_space(cameras);
    // Cameras that look across the room also see far behind it: the middle of the box may be outside the
    // room.
    return lattice_over(space.box, kCell_m, kMaxSide_m, space.middle);
}

}  // namespace kinevox
