// The colours of each part of a subject, learned from its postures, and how well they match a posture: an
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
// by several threads at once, learn() and add() not.
class BodyColours {
  public:
    struct Example {
        std::span<const SilhouetteRays> views;
        std::vector<BodyCapsule> capsules;  // of the posture
    };
    // Replaces what was learned. A cell counts where exactly one part of the body covers it: there the part
    // is seen whether or not another one is placed right.
    void learn(std::span<const Example> examples);
    // Adds an example of a stream to what was learned; earlier ones fade. Views that show others, too, are
    // ignored.
    void add(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules);
    void clear() { cameras_.clear(); }
    bool empty() const { return cameras_.empty(); }

    // Negative log likelihood ratio of the cells' colours with the parts that this posture shows there
    // against the subject's colours as a whole, times the weight of one of the correlated cells.
    double cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules) const;
    double cost(std::span<const SilhouetteRays> views, const BodyModel& model,
                const BodyPosture& posture) const;

  private:
    friend class PartialColourCost;
    static constexpr int kBins = 8;  // per channel
    static constexpr int kColours = kBins * kBins * kBins;
    struct Seen {
        const SilhouetteRays* view;
        std::span<const BodyCapsule> capsules;
    };
    // Of one camera.
    struct Histograms {
        std::array<std::array<float, kBins - 1>, 3> borders{};  // of luminance and two colour differences
        std::vector<float> whole;  // number of cells of each colour; empty: nothing was learned
        std::vector<float> parts;  // of each part, one after the other
        std::array<std::array<float, kColours>, kBodySegmentCount> cost{};  // of a cell
        int bin(const std::array<std::uint8_t, 3>& colour) const;
        void set_borders(std::span<const Seen> views);
        void count(std::span<const Seen> views, double memory);
    };
    std::vector<Histograms> cameras_;
};

// Compares the same cost of postures that differ in some segments only: the other ones are drawn once. Views
// and colours must outlive it. Not thread-safe.
class PartialColourCost {
  public:
    PartialColourCost(const BodyColours& colours, std::span<const SilhouetteRays> views,
                      std::span<const BodyCapsule> fixed);
    // Of the whole body with these capsules, beyond that without them.
    double cost(std::span<const BodyCapsule> moving);

  private:
    static constexpr std::int8_t kNoPart = -1;
    struct Cell {
        std::int8_t part = kNoPart;  // of the fixed capsules
        std::int16_t colour = -1;    // bin; -1: not looked up yet
        float fixed_depth_m = 0, fixed_cost = 0;
        float depth_m = 0, cost = 0;
    };
    struct View {
        const SilhouetteRays* rays;
        const BodyColours::Histograms* learned;
        std::vector<Cell> cells;
    };
    std::vector<View> views_;
    std::vector<std::size_t> changed_;
};

}  // namespace kinevox
