// Things held before the cameras of the virtual studio to calibrate them: a printed board, balls on a wand.
// And a camera that somebody knocked. Drawn over a picture of the empty room, without OpenCV.
#pragma once

#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox::studio {

// A print on a flat board. In the board frame x is right, y up, z out of the print (m); the frame's origin
// lies at `origin_px` of the texture, counted from its upper left corner.
struct Print {
    Picture grey;  // 1 channel
    double pixels_per_m = 1000;
    Vec2 origin_px;
};

struct Ball {
    Vec3 centre_in_world;  // m
    double radius_m = 0.02;
    std::uint8_t grey = 250;
};

// `picture` (B G R) with the board before it, seen from its printed side only; the edges are smooth and the
// board has noise of `noise_grey` of its own.
Picture draw_print(const Picture& picture, const Camera& camera, const Print& print,
                   const Rigid3& world_from_board, double noise_grey, std::uint32_t seed);
Picture draw_balls(const Picture& picture, const Camera& camera, const std::vector<Ball>& balls,
                   double noise_grey, std::uint32_t seed);

// The camera turned about an axis through its own centre (camera frame, radians along the axis) and shifted
// (m, world).
Camera knocked(const Camera& camera, Vec3 turn, Vec3 shift_in_world);

// Where a board is held at a moment, so that over the moments it wanders through the box and is turned about,
// towards the middle of the cameras nearest to it. The same moment, the same place.
Rigid3 held_board(const std::vector<Camera>& cameras, Vec3 lower, Vec3 upper, Vec3 middle_of_board,
                  int moment, std::uint32_t seed);

}  // namespace kinevox::studio
