// Silhouettes of a moving person, as the refinement and the checks use them.
#pragma once

#include <cstdint>
#include <vector>

#include "common/camera.h"

namespace kinevox {

// One camera's at one moment: height * width bytes, 0 or 255; empty where there is none.
struct SilhouettePicture {
    std::vector<std::uint8_t> mask;
    bool cut = false;  // the picture's border cuts the subject

    bool empty() const { return mask.empty(); }
};

// moments[moment][camera].
struct SilhouetteSet {
    std::vector<std::vector<SilhouettePicture>> moments;
};

}  // namespace kinevox
