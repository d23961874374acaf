// Silhouettes to the two maps of kernels/shared/hull.h, on the device.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cuda/volume.h"

namespace kinevox::kernels::cuda {

struct SilhouetteView {
    const std::uint8_t* mask = nullptr;  // host; camera.width * camera.height bytes
    Rect bounds;                         // smallest box around the silhouette, or a larger one
    Projector camera;
    float block_radius_px = 1;  // see kernels/cpu/hull_maps.h
    float miss_budget_permille = 0;
};

// Without the mask's words and the memory of the maps.
MapsOfView frame_maps(const SilhouetteView& view);

// The memory of maps; grows as needed.
class HullMapMemory {
  public:
    // Sets where the maps of `views` are, framed before.
    void place(std::span<MapsOfView> views);

  private:
    DeviceBuffer<std::uint8_t> kind_, fore_, back_, miss_rows_, miss_;
    DeviceBuffer<std::int8_t> cells_;
};

}  // namespace kinevox::kernels::cuda
