// Post-processing of a silhouette after the per-pixel decision. Masks hold 0 or 255, rows without padding.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/cpu/run_components.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/shared/kde_border.h"

namespace kinevox::kernels::cpu {

struct MaskImage {
    std::uint8_t* data = nullptr;
    int width = 0, height = 0;
    std::uint8_t* row(int y) const { return data + static_cast<std::ptrdiff_t>(y) * width; }
};

// Keeps components of at least `min_area` pixels and `min_fraction` of the largest that touch `seed` (if not
// null); clears the others. Returns the area of the largest.
std::int64_t remove_small_components(const MaskImage& mask, const Rect& box, int min_area, float min_fraction,
                                     const std::uint8_t* seed, RunComponents& scratch);

// Fills holes of fewer than `max_area` pixels that do not touch the box's edge.
void fill_holes(const MaskImage& mask, const Rect& box, int max_area, RunComponents& scratch);

// Reclassifies the pixels of `box` within kde::kBorderDepth of the border; `limit` is the part of the image
// for which `cells` holds this frame's values.
class BorderRefiner {
  public:
    void refine(const MaskImage& sharp, const Rect& box, const Rect& limit, const BackgroundModel& model,
                const std::uint8_t* cells, const kde::BorderParameters& parameters);

  private:
    std::vector<std::uint8_t> inside_, grown_, scratch_, zones_;
};

Rect grown(const Rect& box, int margin, int width, int height);

}  // namespace kinevox::kernels::cpu
