// Silhouettes to the two maps of kernels/shared/hull.h, on the device.
#pragma once

#include <cstdint>
#include <span>

#include "kernels/cuda/device.h"
#include "kernels/shared/hull.h"

namespace kinevox::kernels::cuda {

struct SilhouetteView {
    const std::uint8_t* mask = nullptr;  // host; camera.width * camera.height bytes
    Rect bounds;                         // smallest box around the silhouette, or a larger one
    Projector camera;
    float block_radius_px = 1;  // see kernels/cpu/hull_maps.h
};

// What the kernels know of one view; `maps` holds device pointers.
struct MapsOfView {
    HullMaps maps;
    Rect bounds;    // px, clipped to the image
    Rect mask_box;  // px, the part of the image that `mask` holds, without padding
    const std::uint8_t* mask = nullptr;
    std::uint8_t *kind = nullptr, *fore = nullptr, *back = nullptr, *miss_rows = nullptr;  // scratch
    std::int8_t* cells = nullptr;
    std::uint8_t* miss = nullptr;
};

class HullMapMaker {
  public:
    // Queues the work; the maps are ready for what is queued on `stream` later. At least one view. Returns a
    // device array of views.size() maps, valid until the next call. The masks are read before this returns;
    // `stream` must have been waited for since the last call.
    const HullMaps* make(const Stream& stream, std::span<const SilhouetteView> views,
                         float miss_budget_permille);

  private:
    PinnedBuffer<std::uint8_t> masks_;
    PinnedBuffer<MapsOfView> views_;
    PinnedBuffer<HullMaps> maps_;
    DeviceBuffer<std::uint8_t> device_masks_, kind_, fore_, back_, miss_rows_, miss_;
    DeviceBuffer<std::int8_t> cells_;
    DeviceBuffer<MapsOfView> device_views_;
    DeviceBuffer<HullMaps> device_maps_;
};

}  // namespace kinevox::kernels::cuda
