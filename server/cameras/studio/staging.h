// What there is in the virtual studio besides the person, or instead: a board or a wand carried through the
// space to calibrate the cameras, and a camera that somebody knocks. The same options and the same frame give
// the same places.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/cameras/studio/props.h"

namespace kinevox::studio {

struct StagedBoard {
    Print print;
    Vec3 middle_in_board;     // m
    int frames_on_floor = 0;  // in so many first frames it lies on the floor, print up, then it is carried
};

// Balls in a row.
struct StagedWand {
    std::vector<double> along_m;  // from the first ball; the first is 0
    double radius_m = 0.02;
};

// From a time on a camera looks elsewhere, turned about its own centre. The calibration does not know.
struct Knock {
    std::size_t camera = 0;
    double time_s = 0;
    double turn_deg = 0;  // to the side and up or down, the same of each
};

struct Staging {
    bool person = true;
    std::optional<StagedBoard> board;
    std::optional<StagedWand> wand;
    std::optional<Knock> knock;
    Vec3 lower{-1.2, -1.2, 0.4},
        upper{1.2, 1.2, 1.9};  // m, world: the box that board or wand is carried through

    bool has_prop() const { return board || wand; }
    // Empty when usable for so many cameras, else one sentence.
    std::string check(std::size_t cameras) const;
};

// Where board or wand is at a frame. It wanders through the box; the board faces the cameras, one after the
// other in the order of their directions, once around in 24 s, and is tilted meanwhile; the wand turns every
// way.
Rigid3 world_from_prop(const Staging& staging, const std::vector<Camera>& cameras, std::int64_t frame,
                       double fps);

// `picture` with board or wand before it, as `camera` sees it at world_from_prop().
Picture draw_prop(const Staging& staging, const Picture& picture, const Camera& camera,
                  const Rigid3& world_from_prop, double noise_grey, std::uint32_t seed);

// Where the knocked camera looks afterwards.
Camera after_knock(const Knock& knock, const std::vector<Camera>& cameras);

}  // namespace kinevox::studio
