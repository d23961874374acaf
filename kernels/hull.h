// The visual hull: the voxels of a lattice whose projection lies in the silhouette of every camera that could
// see them, found coarse to fine so that the cost follows the surface (paper 3.2, IBVH stage).
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "kernels/types.h"

namespace kinevox::kernels {

struct HullOptions {
    // A voxel is kept only if at least this many cameras see and contain it; cameras that cannot see it
    // (behind them or outside their picture) do not vote.
    int min_views = 2;

    // Calibration and silhouettes are never exact: a voxel that misses silhouettes survives if its misses,
    // summed over all cameras, are at most this many thousandths of the picture's longer side (5 of 640
    // px: 3.2 px, rounded down). One budget for all cameras together rescues a limb that one camera is a
    // little off on without swelling the whole body as dilating every silhouette would. 0: strictly inside.
    // At most 50.
    float miss_budget_permille = 0;

    // A hole in one silhouette drills a tunnel through the volume. What the rest surrounds within this length
    // along all lines but one (kernels/shared/surrounded.h) is filled again, in the bricks that have any
    // voxel; m. 0: not.
    float fill_reach_m = 0.08f;

    std::string check() const;
};

// One camera's evidence. `silhouette` is the loose one: camera.width * camera.height bytes, 0 or 255, no
// padding; null if this camera has no picture now: then it does not vote.
struct HullView {
    const CameraModel* camera = nullptr;
    const std::uint8_t* silhouette = nullptr;
    const std::uint8_t* probability = nullptr;  // of foreground, same shape, or null; not used
    Rect bounds;                                // smallest box around the silhouette, or a larger one
};

// Not thread safe; keeps its working memory from call to call.
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
