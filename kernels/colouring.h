// Voxel colouring (Seitz and Dyer 1997, paper 3.2): each surface voxel is projected to the cameras that see
// it, occlusion decided by the volume itself; voxels whose colours disagree are carved, until nothing changes
// or `max_rounds` is reached; what remains carries its colour.
//
// Three kinds of evidence carve, each from the surface inwards:
//  1. the sharp silhouettes: what sticks out of them by more than a small budget is background that the loose
//  ones
//     let through;
//  2. photo-consistency: the mean colours around a voxel's projections must agree within the noise and what
//  the
//     window itself spreads (a voxel on an edge of a print may look different, a voxel of plain cloth may
//     not);
//  3. roundness: four cameras around a body leave it with corners that no camera can see past. A surface
//  voxel
//     with little of the volume around it goes, as in a flow by mean curvature.
// Colours and roundness carve only where the rays through the voxel keep enough of the volume, so that no
// silhouette loses a limb, however the calibration is off.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels {

struct ColouringOptions {
    // Carving rounds at most; 0 only colours. Each looks at the whole surface once, with the occlusions that
    // the round before left.
    int max_rounds = 6;

    // A voxel may stick out of the sharp silhouettes by this many thousandths of the picture's longer side,
    // summed over the views (as HullOptions::miss_budget_permille). Negative: the sharp silhouettes are not
    // asked.
    float sharp_budget_permille = 1;

    // What the sharp silhouettes took is filled again where the rest of the volume surrounds it within this
    // length, m (as HullOptions::fill_reach_m): a hole in one of them drills a tunnel. 0: not.
    float fill_reach_m = 0.08f;

    // Colours disagree where means differ by more than this many times (noise_grey + the windows' own
    // standard deviation), in any channel. 0: colours do not carve.
    float max_colour_deviation = 2;
    float noise_grey = 4;  // grey levels (0..255): sensor noise, and how equally the cameras see a colour

    // Roundness looks at a cube of this edge around a surface voxel, m; the voxel goes if less than
    // `min_support` of it is occupied (a flat surface has 0.5, an edge of a box 0.25). 0: no rounding.
    float support_edge_m = 0.07f;
    float min_support = 0.47f;

    // Colours and roundness leave every ray at least this much of the volume, m: a little more than a
    // forearm.
    float keep_on_ray_m = 0.1f;

    std::string check() const;
};

struct ColouringView {
    const CameraModel* camera = nullptr;
    PictureView picture;  // B, G, R or grey, the camera's size; no data: it does not colour
    const std::uint8_t* silhouette = nullptr;  // the loose one, as HullView; used for the agreement; or null
    const std::uint8_t* sharp = nullptr;       // or null: then this view's silhouette does not carve
    Rect bounds = {};                          // of the silhouette; empty: looked for
};

struct ColouringReport {
    int rounds = 0;
    std::int64_t carved = 0;  // voxels, less those that were filled again
    // Per view: intersection over union of the volume's own projection and the silhouette (the sharp one
    // where there is one), 0..1; NaN where both are empty or there is no silhouette.
    std::vector<float> silhouette_iou;
};

// Not thread safe; keeps its working memory from call to call.
class VoxelColourer {
  public:
    virtual ~VoxelColourer() = default;
    // Carves `volume` and fills its colours. Throws std::invalid_argument for a view without a camera and for
    // a picture that does not fit its camera.
    virtual void colour(std::span<const ColouringView> views, VoxelVolume& volume,
                        ColouringReport& report) = 0;
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent.
std::unique_ptr<VoxelColourer> make_voxel_colourer(Device device, const ColouringOptions& options = {});

}  // namespace kinevox::kernels
