// Masks on the device: connected components, small components and holes, the zones along a border.
#pragma once

#include <cstdint>

#include "kernels/cuda/device.h"
#include "kernels/types.h"

namespace kinevox::kernels::cuda {

class MaskCleaner {
  public:
    // Masks hold 0 or 255, `width` bytes a row; only what lies in `box`, which must not be empty, is looked
    // at. As kernels/cpu/segmentation_masks.h, with the same result.
    void remove_small_components(const Stream& stream, std::uint8_t* mask, int width, const Rect& box,
                                 int min_area, float min_fraction, const std::uint8_t* seed);
    // `max_fraction` is of the largest component that the last call of remove_small_components() found.
    void fill_holes(const Stream& stream, std::uint8_t* mask, int width, const Rect& box, int max_area,
                    float max_fraction);

  private:
    void find(const Stream& stream, const std::uint8_t* mask, int width, const Rect& box, bool set,
              bool eight, const std::uint8_t* seed);
    DeviceBuffer<int> labels_, areas_, flags_, largest_;
};

// zones (kde::kZone..): inside, outside, or within two steps of the border of `sharp`; for the pixels of
// `box`.
void find_zones(const Stream& stream, const std::uint8_t* sharp, int width, int height, const Rect& box,
                std::uint8_t* zones);

}  // namespace kinevox::kernels::cuda
