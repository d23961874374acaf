// Balls along capsules, and how far they project beyond the border of a silhouette.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "common/geometry.h"
#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// Keeps its memory.
class CapsuleBalls {
  public:
    // One ball per capsule and position `along` its axis, 0..1, in this order.
    void place(std::span<const BodyCapsule> capsules, std::span<const double> along);
    // Against a silhouette of a camera that is used.
    void measure(const SilhouetteRays& view);

    std::size_t size() const { return placed_[0].size(); }
    Vec3 in_world(std::size_t ball) const { return at(placed_, 0, ball); }
    double radius_m(std::size_t ball) const { return placed_[3][ball]; }

    // Of the last measure(). 0 or less: inside, or this camera does not see it.
    double outside_m(std::size_t ball) const { return measured_[0][ball]; }
    Vec3 in_camera(std::size_t ball) const { return at(measured_, 1, ball); }
    // Of the distance to the border, px per px to the right and down.
    Vec2 slope(std::size_t ball) const { return {measured_[4][ball], measured_[5][ball]}; }
    Vec2 pixel(std::size_t ball) const { return {measured_[6][ball], measured_[7][ball]}; }

  private:
    template <typename Arrays>
    static Vec3 at(const Arrays& arrays, std::size_t first, std::size_t ball) {
        return {arrays[first][ball], arrays[first + 1][ball], arrays[first + 2][ball]};
    }

    std::array<std::vector<double>, 4> placed_;    // x, y, z and radius, m
    std::array<std::vector<double>, 8> measured_;  // see kernels::OutsideList
};

}  // namespace kinevox
