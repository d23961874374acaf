// Calibration targets of the virtual studio: a printed board, and balls on a wand. Drawn over an image of the
// empty room, without OpenCV. Also a bumped camera.
#pragma once

#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox::studio {

// A print on a flat board. Board frame (m): x right, y up, z out of the print; its origin is at `origin_px`
// of the texture, from the upper left corner.
struct Print {
    Image grey;  // 1 channel
    double pixels_per_m = 1000;
    Vec2 origin_px;
};

struct Ball {
    Vec3 centre_in_world;  // m
    double radius_m = 0.02;
    std::uint8_t grey = 250;
};

// `image` (B G R) with the board drawn over it, visible from the printed side only, antialiased and with
// its own noise of `noise_grey` grey levels.
Image draw_print(const Image& image, const Camera& camera, const Print& print, const Rigid3& world_from_board,
                 double noise_grey, std::uint32_t seed);
Image draw_balls(const Image& image, const Camera& camera, const std::vector<Ball>& balls, double noise_grey,
                 std::uint32_t seed);

// The camera after a rotation about its centre (rotation vector, camera frame, rad) and a shift (m, world).
Camera bumped_camera(const Camera& camera, Vec3 rotation, Vec3 shift_in_world);

// Pose of a hand-held board in frame set `frame`: moves through the box and faces a point between two
// neighbouring cameras, tilted. Deterministic.
Rigid3 held_board(const std::vector<Camera>& cameras, Vec3 lower, Vec3 upper, Vec3 centre_in_board, int frame,
                  std::uint32_t seed);

}  // namespace kinevox::studio
