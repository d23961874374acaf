// How far silhouettes and the hull carved from them agree.
#pragma once

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct HullAgreementOptions {
    int pixels = 1500;      // of each silhouette that are asked, evenly over it
    double reach_m = 1.6;   // along each ray, from the subject's middle
    double step_m = 0.004;  // along each ray where a silhouette is near
    int max_moments = 40;   // evenly from those given
};

// Intersection over union of each silhouette and the hull's projection into its picture, exactly, without
// voxels: a pixel belongs to the projection if its ray meets all the other silhouettes at one place. The hull
// lies within every silhouette, so the union is the silhouette. (A hull of voxels comes out wider by about a
// voxel on each side, and that hides what a wrong camera cuts off.)
HullAgreement hull_agreement(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                             const HullAgreementOptions& options = {});

}  // namespace kinevox
