// Contents of the virtual studio besides the person: a calibration target carried through the space, and a
// camera that is bumped. Deterministic.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox::studio {

// Calibration targets: a printed board, and balls on a wand. Drawn over an image of the empty room, without
// OpenCV. Also a bumped camera.

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

struct StagedBoard {
    Print print;
    Vec3 centre_in_board;     // m
    int frames_on_floor = 0;  // number of first frames in which it lies on the floor, print up
};

// Balls in a row.
struct StagedWand {
    std::vector<double> along_m;  // positions from the first ball; the first is 0
    double radius_m = 0.02;
};

// A camera that rotates about its centre at a time; the calibration is not updated.
struct CameraBump {
    std::size_t camera = 0;
    double time_s = 0;
    double rotation_deg = 0;  // in equal parts about the camera's x and y axes
};

struct Staging {
    bool person = true;
    std::optional<StagedBoard> board;
    std::optional<StagedWand> wand;
    std::optional<CameraBump> bump;
    Vec3 lower{-1.2, -1.2, 0.4}, upper{1.2, 1.2, 1.9};  // m, world: the box that the target moves in

    bool has_target() const { return board || wand; }
    // Empty when valid for this number of cameras, else one sentence.
    std::string check(std::size_t camera_count) const;
};

// Pose of the target in a frame. It moves through the box; the board faces the cameras in the order of their
// directions, all within 24 s, with varying tilt; the wand rotates about all axes.
Rigid3 world_from_target(const Staging& staging, const std::vector<Camera>& cameras, std::int64_t frame,
                         double fps);

// `image` with the target drawn over it at world_from_target().
Image draw_target(const Staging& staging, const Image& image, const Camera& camera,
                  const Rigid3& world_from_target, double noise_grey, std::uint32_t seed);

// The camera after the bump.
Camera camera_after_bump(const CameraBump& bump, const std::vector<Camera>& cameras);

}  // namespace kinevox::studio
