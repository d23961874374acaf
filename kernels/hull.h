// The visual hull: the voxels of a lattice whose projection lies in the silhouette of every camera that could
// see them, found coarse to fine so that the cost follows the surface (paper 3.2, IBVH stage).
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "kernels/option_list.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// With this many cameras, a voxel that only two of them see is not carved: behind the borders of the other
// images, the cones of two opposite cameras intersect in a long ghost.
inline constexpr std::size_t kManyCameras = 4;
inline constexpr int kMinViewsOfMany = 3;

struct HullOptions {
    // Minimum number of cameras that see and contain a voxel; cameras that cannot see it (behind them or
    // outside their image) do not vote.
    int min_views = 2;

    // Tolerance for errors of calibration and silhouettes: a voxel outside silhouettes is kept if its
    // distances to them, summed over all cameras, are at most this many thousandths of the longer image side
    // (5 of 640 px: 3.2 px, rounded down). One budget for all cameras keeps a limb that one camera misplaces
    // without enlarging the whole body, as dilating every silhouette would. 0: strictly inside. At most 50.
    float miss_budget_permille = 0;

    // A hole in one silhouette causes a tunnel through the volume. Voxels surrounded by the volume within
    // this distance (m) along all lines but one (kernels/shared/surrounded.h) are filled, in non-empty
    // bricks. 0: off.
    float fill_radius_m = 0.08f;

    std::string check() const;
    bool operator==(const HullOptions&) const = default;
};

template <typename T, typename F>
requires SameOptions<T, HullOptions>
void visit_options(T& o, F&& f) {
    f({"min_views", 1, 64, "", "Minimum number of cameras that see and contain a voxel."}, o.min_views);
    f({"miss_budget_permille", 0, 50, "1/1000 of the longer image side",
       "Distance by which a voxel may lie outside silhouettes, summed over the cameras."},
      o.miss_budget_permille);
    f({"fill_radius_m", 0, 1, "m", "Radius within which surrounded holes are filled; 0: off."},
      o.fill_radius_m);
}

// One camera's evidence. `silhouette` is the loose one: camera.width * camera.height bytes, 0 or 255, no
// padding; null if this camera has no image now: then it does not vote.
struct HullView {
    const CameraModel* camera = nullptr;
    const std::uint8_t* silhouette = nullptr;
    Rect bounds;  // smallest box around the silhouette, or a larger one
};

// Not thread-safe; keeps its working memory from call to call.
class HullCarver {
  public:
    virtual ~HullCarver() = default;
    // `out` gets the lattice, the occupied bricks and no colours. Throws std::invalid_argument for a lattice
    // whose sizes are not positive multiples of kBrickEdge or that has more than 2^31 voxels, and for a
    // camera that make_projector() refuses.
    virtual void carve(std::span<const HullView> views, const Lattice& lattice, VoxelVolume& out) = 0;
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent.
std::unique_ptr<HullCarver> make_hull_carver(Device device, const HullOptions& options = {});

}  // namespace kinevox::kernels
