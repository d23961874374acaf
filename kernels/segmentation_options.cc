#include <sstream>

#include "kernels/segmentation.h"

namespace kinevox::kernels {
namespace {

template <class T>
std::string outside(const char* field, T value, T low, T high) {
    if (value >= low && value <= high) return "";  // false for NaN too
    std::ostringstream text;
    text << field << " is " << value << "; " << low << " to " << high << " is allowed";
    return text.str();
}

}  // namespace

std::string SegmentationOptions::check() const {
    constexpr float kOpen = 1e-4f;
    for (const std::string& problem :
         {outside("samples", samples, 1, 255), outside("min_bandwidth", min_bandwidth, 1.0f, 32.0f),
          outside("assumed_noise", assumed_noise, 1.0f, 32.0f),
          outside("update_interval", update_interval, 0, 100000),
          outside("long_term_interval", long_term_interval, 1, 100000),
          outside("absorb_frames", absorb_frames, 1, 100000000),
          outside("darkest_shadow", darkest_shadow, 0.05f, 1.0f),
          outside("brightest_light", brightest_light, 1.0f, 4.0f),
          outside("light_change_prior", light_change_prior, 1e-9f, 1 - kOpen),
          outside("max_hole_part", max_hole_part, 0.0f, 1.0f),
          outside("colour_memory_share", colour_memory_share, 0.0f, 1 - kOpen),
          outside("sharp_threshold", sharp_threshold, kOpen, 1 - kOpen),
          outside("loose_threshold", loose_threshold, kOpen, 1 - kOpen),
          outside("min_island_px", min_island_px, 0, 1000000000),
          outside("min_island_part", min_island_part, 0.0f, 1.0f),
          outside("max_hole_px", max_hole_px, 0, 1000000000)})
        if (!problem.empty()) return problem;
    if (loose_threshold > sharp_threshold) return "loose_threshold is above sharp_threshold; it must not be";
    return "";
}

}  // namespace kinevox::kernels
