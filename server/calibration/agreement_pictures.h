// Pictures of how far silhouettes and their hull agree, for the certificate.
#pragma once

#include <vector>

#include "server/calibration/certificate.h"
#include "server/calibration/silhouette_set.h"

namespace kinevox {

// One a camera, all of the moment that most cameras see whole; none where there is no hull.
std::vector<AgreementPicture> agreement_pictures(const std::vector<Camera>& cameras,
                                                 const SilhouetteSet& silhouettes);

}  // namespace kinevox
