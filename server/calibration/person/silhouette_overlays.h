// Overlay images of silhouettes and their hull, for the certificate.
#pragma once

#include <string>
#include <vector>

#include "common/camera.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

struct SilhouetteOverlay {
    std::string camera;
    std::string png;  // white: both; orange: silhouette only; blue: hull only
};

// One per camera, of the frame set that most cameras see completely; none without a hull.
std::vector<SilhouetteOverlay> silhouette_overlays(const std::vector<Camera>& cameras,
                                                   const SilhouetteSet& silhouettes);

}  // namespace kinevox
