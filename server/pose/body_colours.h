// The colours of each part of a subject, learned from a recording, and how well they match a posture: an
// arm before the trunk changes no silhouette, but shows its sleeve and skin.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// Histograms per camera, so that neither the cameras' colours nor the light need be alike; their bins hold
// equal numbers of the subject's cells per channel. Left and right limbs share theirs. cost() may be called
// by several threads at once, learn() not.
class BodyColours {
  public:
    struct Example {
        std::span<const SilhouetteRays> views;
        std::vector<BodyCapsule> capsules;  // of the posture
    };
    // Replaces what was learned. A cell counts where exactly one part of the body covers it: there the part
    // is seen whether or not another one is placed right.
    void learn(std::span<const Example> examples);

    // Negative log likelihood ratio of the cells' colours with the parts that this posture shows there
    // against the subject's colours as a whole, times the weight of one of the correlated cells.
    double cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules) const;

  private:
    static constexpr int kBins = 8;  // per channel
    static constexpr int kColours = kBins * kBins * kBins;
    struct Seen {
        const SilhouetteRays* view;
        const std::vector<BodyCapsule>* capsules;
    };
    // Of one camera.
    struct Histograms {
        std::array<std::array<float, kBins - 1>, 3> borders{};  // of luminance and two colour differences
        std::array<std::array<float, kColours>, kBodySegmentCount> cost{};  // of a cell
        int bin(const std::array<std::uint8_t, 3>& colour) const;
        void set_borders(std::span<const Seen> views);
        void count(std::span<const Seen> views);
    };
    std::vector<Histograms> cameras_;
};

}  // namespace kinevox
