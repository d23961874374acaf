// Where an arm is, by silhouettes and colours together: before the trunk the silhouettes hardly show it.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "server/pose/arm_cost.h"
#include "server/pose/body_colours.h"
#include "server/pose/body_model.h"
#include "server/pose/limb_search.h"

namespace kinevox {

struct MovedArm {
    BodyPosture posture;
    double cost = 0;         // against the silhouettes, see ArmCost
    double colour_cost = 0;  // of the arm
    double total() const { return cost + colour_cost; }
};

// Moves one arm, kArmL or kArmR: bends the elbow, rotates the upper arm about its own axis and the elbow
// around the line from shoulder to wrist. Model, views and colours must outlive it.
class ArmSearch {
  public:
    ArmSearch(const BodyModel& model, const BodyPosture& posture, Limb arm,
              std::span<const SilhouetteRays> views, const BodyColours& colours,
              const PoseFitOptions& options);

    // Moves by each of these angles (rad), as often as the total falls, but at most `max_moves` times.
    void improve(std::span<const double> angles, int max_moves);
    // The same from the arm's other configurations that the silhouettes allow; if there are more, from the
    // `max_starts` cheapest.
    void improve_anywhere(LimbSearch& limbs, std::span<const double> angles, int max_moves,
                          std::size_t max_starts = std::numeric_limits<std::size_t>::max());
    // The best so far, and the decrease of its total.
    const MovedArm& best() const { return best_; }
    double gain() const { return before_ - best_.total(); }
    // The best one moved by an angle (rad) about each of the three axes, in either direction.
    std::array<MovedArm, 6> around(double angle) { return around(best_.posture, angle); }

  private:
    std::array<MovedArm, 6> around(const BodyPosture& posture, double angle);
    MovedArm descended(MovedArm from, std::span<const double> angles, int max_moves);
    MovedArm judge(const BodyPosture& posture);

    const BodyModel& model_;
    Limb which_;
    LimbSegments arm_;
    std::span<const SilhouetteRays> views_;
    double robust_m_;
    ArmCost cost_;
    PartialColourCost colour_;
    MovedArm best_;
    double before_ = 0;
};

}  // namespace kinevox
