// Cameras around a room and what they would see of a board, without pictures.
#pragma once

#include <functional>
#include <random>
#include <vector>

#include "server/calibration/extrinsics.h"
#include "server/cameras/studio/props.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::testing {

inline const BoardSpec kBoard = *parse_board("charuco:6x5:160:120:DICT_4X4_100");

inline std::vector<Camera> ring(int count) {
    studio::StudioOptions options;
    options.cameras = count, options.width = 1280, options.height = 960, options.distortion = 0.05;
    return studio::ring_of_cameras(options, false);
}

inline std::vector<Camera> lenses_of(std::vector<Camera> cameras) {
    for (Camera& camera : cameras) camera.camera_from_world = {};
    return cameras;
}

// Noise of 0.2 px. Nothing where the print is not seen or the view is too flat.
inline BoardSighting see_board(const Camera& camera, const std::vector<Vec3>& points,
                               const Rigid3& world_from_board, std::mt19937& random) {
    BoardSighting sighting;
    std::normal_distribution<double> noise(0, 0.2);
    const Vec3 eye = world_from_board.inverse() * camera.centre_in_world();
    if (eye.z < 0.25 * norm(eye)) return sighting;
    for (std::size_t p = 0; p < points.size(); ++p) {
        const auto seen = camera.project(world_from_board * points[p]);
        if (seen && seen->x > 0 && seen->y > 0 && seen->x < camera.width && seen->y < camera.height)
            sighting.corners.push_back(
                {static_cast<int>(p), {seen->x + noise(random), seen->y + noise(random)}});
    }
    if (sighting.corners.size() < 8) sighting.corners.clear();
    sighting.edge_px = 2;
    return sighting;
}

inline Rigid3 board_at(const std::vector<Camera>& cameras, int moment) {
    return studio::held_board(cameras, {-1, -1, 0.4}, {1, 1, 1.8}, {0.4, 0.3, 0}, moment, 5);
}

}  // namespace kinevox::testing
