// Voxel colouring (Seitz and Dyer 1997, paper 3.2): each surface voxel is projected to the cameras that see
// it, with occlusion by the volume itself; photo-inconsistent voxels are carved until nothing changes or
// `max_rounds` is reached; the remaining ones are coloured.
//
// Three kinds of evidence carve, each from the surface inwards:
//  1. The sharp silhouettes: voxels outside them by more than a small budget are background that the loose
//     silhouettes contain.
//  2. Photo-consistency: the mean colours around a voxel's projections must be equal within the noise and the
//     spread of the window (a voxel on an edge of a print may differ, a voxel of plain cloth may not).
//  3. Roundness: four cameras leave a body with corners that no camera sees. Surface voxels with little
//  volume
//     around them are carved, as in mean curvature flow.
// Colours and roundness carve only if the rays through the voxel keep enough of the volume, so that no limb
// is lost when the calibration is inaccurate.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "kernels/hull.h"
#include "kernels/option_list.h"
#include "kernels/types.h"

namespace kinevox::kernels {

struct ColouringOptions {
    // Maximum number of carving rounds; 0: only colour. Each round tests the whole surface, with the
    // occlusions after the previous round.
    int max_rounds = 6;

    // Tolerance outside the sharp silhouettes, in thousandths of the longer image side, summed over the views
    // (as HullOptions::miss_budget_permille). Negative: the sharp silhouettes are not used.
    float sharp_budget_permille = 1;

    // Voxels carved by the sharp silhouettes are filled if the volume surrounds them within this distance, m
    // (as HullOptions::fill_radius_m). 0: off.
    float fill_radius_m = 0.08f;

    // Colours are inconsistent if means differ by more than this multiple of (noise_grey + the sigma of the
    // windows) in any channel. 0: colours do not carve.
    float max_colour_difference_std = 2;
    float noise_grey = 4;  // grey levels (0..255): sensor noise and colour differences between the cameras

    // Roundness: a surface voxel is carved if less than `min_support` of a cube of this edge (m) around it is
    // occupied (a flat surface has 0.5, an edge of a box 0.25). 0: off.
    float support_edge_m = 0.07f;
    float min_support = 0.47f;

    // Colours and roundness keep at least this length of the volume along every ray, m: a little more than a
    // forearm.
    float min_ray_length_m = 0.1f;

    std::string check() const;
    bool operator==(const ColouringOptions&) const = default;
};

template <typename T, typename F>
requires SameOptions<T, ColouringOptions>
void visit_options(T& o, F&& f) {
    f({"max_rounds", 0, 1000, "", "Maximum number of carving rounds; 0: colour only."}, o.max_rounds);
    f({"sharp_budget_permille", -1e6, 50, "1/1000 of the longer image side",
       "Distance by which a voxel may lie outside the sharp silhouettes; negative: off."},
      o.sharp_budget_permille);
    f({"fill_radius_m", 0, 1, "m", "Radius within which surrounded holes are filled; 0: off."},
      o.fill_radius_m);
    f({"max_colour_difference_std", 0, 1000, "sigma",
       "Maximum colour difference between cameras; 0: colours do not carve."},
      o.max_colour_difference_std);
    f({"noise_grey", 0.1, 255, "grey levels", "Noise of colours between cameras."}, o.noise_grey);
    f({"support_edge_m", 0, 1, "m", "Edge of the cube that measures roundness; 0: off."}, o.support_edge_m);
    f({"min_support", 0, 0.5, "", "Minimum occupied fraction of that cube."}, o.min_support);
    f({"min_ray_length_m", 0, 1, "m", "Minimum volume left along each ray."}, o.min_ray_length_m);
}

struct ColouringView {
    const CameraModel* camera = nullptr;
    ImageView image;                           // B, G, R or grey, the camera's size; no data: no colours
    const std::uint8_t* silhouette = nullptr;  // the loose one, as HullView, or null; for the silhouette IoU
    const std::uint8_t* sharp = nullptr;       // null: this view's silhouette does not carve
    Rect bounds = {};                          // of the silhouette; empty: computed
    // See Segmenter::image_on_device(); null: a GPU copies `image`.
    const std::uint8_t* image_on_device = nullptr;
};

struct ColouringReport {
    int rounds = 0;
    std::int64_t carved = 0;  // voxels, without those that were filled again
    // Per view: intersection over union of the volume's own projection and the silhouette (the sharp one
    // if there is one), 0..1; NaN if both are empty or there is no silhouette.
    std::vector<float> silhouette_iou;
};

// Not thread safe; keeps its working memory from call to call.
class VoxelColourer {
  public:
    virtual ~VoxelColourer() = default;
    // Carves `volume` and fills its colours. Throws std::invalid_argument for a view without a camera or an
    // image that does not match its camera.
    virtual void colour(std::span<const ColouringView> views, VoxelVolume& volume,
                        ColouringReport& report) = 0;

    // As carver.carve() and colour(). A GPU does not return the hull in between if carves_and_colours() is
    // true.
    virtual void carve_and_colour(HullCarver& carver, std::span<const HullView> hull_views,
                                  const Lattice& lattice, std::span<const ColouringView> views,
                                  VoxelVolume& volume, ColouringReport& report);
    virtual bool carves_and_colours() const { return false; }
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent.
std::unique_ptr<VoxelColourer> make_voxel_colourer(Device device, const ColouringOptions& options = {});

}  // namespace kinevox::kernels
