// How far silhouettes and the hull carved from them agree.
#pragma once

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

struct HullAgreementOptions {
    double voxel_m = 0.015;
    double side_m = 2.6;    // of the box around the subject
    int most_moments = 40;  // evenly from those given
};

// Carves each moment's hull, strictly, and compares its projection with each silhouette that is not cut by
// its picture: intersection over union.
HullAgreement hull_agreement(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                             const HullAgreementOptions& options = {});

}  // namespace kinevox
