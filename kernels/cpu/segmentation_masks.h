// What happens to a silhouette after its pixels were decided one by one. Masks hold 0 or 255, rows without
// padding.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/cpu/run_components.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/shared/kde_border.h"

namespace kinevox::kernels::cpu {

struct MaskPicture {
    std::uint8_t* data = nullptr;
    int width = 0, height = 0;
    std::uint8_t* row(int y) const { return data + static_cast<std::ptrdiff_t>(y) * width; }
};

// Keeps an island of at least `min_area` pixels that touches `seed` (null: no matter) and is no smaller than
// `min_part` of the largest; clears the others. Returns the area of the largest.
std::int64_t drop_islands(const MaskPicture& mask, const Rect& box, int min_area, float min_part,
                          const std::uint8_t* seed, RunComponents& scratch);

// Sets holes of fewer than `max_area` pixels that do not reach the box's edge.
void fill_holes(const MaskPicture& mask, const Rect& box, int max_area, RunComponents& scratch);

// Decides the pixels of `box` within kde::kBorderDepth of the border anew; `limit` is the part of the picture
// for which `cells` holds this frame's values.
class BorderRefiner {
  public:
    void refine(const MaskPicture& sharp, const Rect& box, const Rect& limit, const BackgroundModel& model,
                const std::uint8_t* cells, const kde::BorderParameters& parameters);

  private:
    std::vector<std::uint8_t> inside_, grown_, scratch_, zones_;
};

Rect grown(const Rect& box, int margin, int width, int height);

}  // namespace kinevox::kernels::cpu
