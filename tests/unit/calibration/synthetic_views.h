// Cameras around a room and their detections of a board, without images.
#pragma once

#include <functional>
#include <random>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/cameras/studio/staging.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::testing {

inline const BoardSpec kBoard = *parse_board("charuco:6x5:160:120:DICT_4X4_100");

inline std::vector<Camera> ring(int count) {
    studio::StudioOptions options;
    options.cameras = count, options.width = 1280, options.height = 960, options.distortion = 0.05;
    return studio::ring_of_cameras(options, false);
}

inline std::vector<Camera> intrinsics_from(std::vector<Camera> cameras) {
    for (Camera& camera : cameras) camera.camera_from_world = {};
    return cameras;
}

// With noise of 0.2 px. Empty if the print is not visible or the view is too flat.
inline BoardDetection see_board(const Camera& camera, const std::vector<Vec3>& points,
                                const Rigid3& world_from_board, std::mt19937& random) {
    BoardDetection detection;
    std::normal_distribution<double> noise(0, 0.2);
    const Vec3 eye = world_from_board.inverse() * camera.centre_in_world();
    if (eye.z < 0.25 * norm(eye)) return detection;
    for (std::size_t p = 0; p < points.size(); ++p) {
        const auto seen = camera.project(world_from_board * points[p]);
        if (seen && seen->x > 0 && seen->y > 0 && seen->x < camera.width && seen->y < camera.height)
            detection.corners.push_back(
                {static_cast<int>(p), {seen->x + noise(random), seen->y + noise(random)}});
    }
    if (detection.corners.size() < 8) detection.corners.clear();
    detection.edge_px = 2;
    return detection;
}

inline Rigid3 board_at(const std::vector<Camera>& cameras, int frame_set) {
    return studio::held_board(cameras, {-1, -1, 0.4}, {1, 1, 1.8}, {0.4, 0.3, 0}, frame_set, 5);
}

}  // namespace kinevox::testing
