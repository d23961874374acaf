// Exact hull IoU: silhouettes against the visual hull of the other views.
#pragma once

#include <vector>

#include "common/camera.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

struct HullIou {
    std::vector<double> iou;  // per camera, mean over frame sets, 0 to 1; NaN: not evaluated
    double mean_iou = 0;      // over frame sets and cameras
    int frames = 0;
};

struct HullIouOptions {
    int pixels = 1500;        // sampled per silhouette, evenly
    double radius_m = 1.6;    // along each ray, from the subject's centre
    double step_m = 0.004;    // along each ray near a silhouette
    int max_frame_sets = 40;  // an even selection
};

// Intersection over union of each silhouette and the projection of the hull of the other silhouettes, without
// voxels: a pixel belongs to the projection if its ray intersects all other silhouettes at one point. The
// hull lies within every silhouette, so the union is the silhouette. (A voxel hull is wider by about one
// voxel per side, which hides what a wrong camera removes.)
HullIou hull_iou(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                 const HullIouOptions& options = {});

}  // namespace kinevox
