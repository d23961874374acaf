// What a person looks like to all cameras together: body size and the colours of legs, trunk and head, each
// as a histogram, so that a person can be recognised by it.
#pragma once

#include <array>
#include <span>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pipeline/tracking/occupied_cells.h"

namespace kinevox {

// Fractions over soft bins of luminance (logarithmic) and two chromaticities, which change little with the
// distance from a lamp.
class ColourHistogram {
  public:
    void add(kernels::Colour colour);
    void add(const ColourHistogram& other, float weight);
    void scale(float factor);
    float weight() const { return weight_; }
    // Bhattacharyya coefficient: 0 for no colour in common, 1 for the same; both weights must be positive.
    // The other one's luminances are shifted by this number of bins, half an octave each.
    double similarity(const ColourHistogram& other, int shift) const;

  private:
    static constexpr int kLuminances = 11, kChromaticities = 9;
    std::array<float, kLuminances * kChromaticities * kChromaticities> bins_{};
    float weight_ = 0;
};

enum BodyBand { kLegsBand, kTrunkBand, kHeadBand, kBodyBands };

struct Appearance {
    std::array<ColourHistogram, kBodyBands> colours;
    double top_m = 0;  // above the floor
    double litres = 0;
};

// Colours of two appearances: 0 for the same, 1 for none in common; NaN if less than half of the body can be
// compared. Light that is up to an octave brighter or darker for the whole body costs little.
double colour_distance(const Appearance& a, const Appearance& b);

// Per camera; an image without data is not used.
struct AppearanceView {
    const Camera* camera = nullptr;
    kernels::ImageView image;
    const kernels::Silhouettes* silhouettes = nullptr;
};

// Of the surface of a body, where nothing else in the grid hides it.
Appearance appearance_of(const OccupiedCells& grid, const Cells& body, std::span<const AppearanceView> views);

}  // namespace kinevox
