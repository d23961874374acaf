// Silhouettes of a moving person in several cameras.
#pragma once

#include <cstdint>
#include <vector>

namespace kinevox {

// Of one camera in one frame set: height * width bytes, 0 or 255; empty if there is none.
struct SilhouetteMask {
    std::vector<std::uint8_t> mask;
    bool truncated = false;  // by the image border

    bool empty() const { return mask.empty(); }
};

// frame_sets[frame set][camera].
struct SilhouetteSet {
    std::vector<std::vector<SilhouetteMask>> frame_sets;
};

}  // namespace kinevox
