// A session in which a board is moved about before four cameras of the virtual studio.
#pragma once

#include <oneapi/tbb/parallel_for.h>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/calibration/board/board_detector.h"
#include "server/cameras/studio/staging.h"
#include "server/cameras/studio/studio.h"
#include "tests/integration/daemon/calibration_operator.h"

namespace kinevox::testing {

inline constexpr int kMoments = 30;  // of a loop
inline constexpr double kFps = 10;

// Four cameras whose session has a calibration that is a little off; the board wanders, and lies on the floor
// in the first images.
struct BoardSession {
    std::vector<Camera> truth;
    std::filesystem::path session;
};

// Each camera a little above the floor's middle sees a board that lies there.
inline Rigid3 on_floor() {
    return Rigid3{Mat3{}, {-0.48, -0.40, 0}};
}

inline BoardSession write_board_session(const std::filesystem::path& folder) {
    studio::StudioOptions options;
    options.cameras = 4, options.width = 640, options.height = 480, options.fps = kFps;
    const auto detector = BoardDetector::create(*parse_board(kBoard));
    must(detector.status());
    studio::Print print;
    print.grey = (*detector)->draw(print.pixels_per_m, print.origin_px);

    BoardSession out{studio::ring_of_cameras(options, false), folder / "session.toml"};
    Session session{"board", kFps, folder / "calibration.toml", {}, {}};
    std::vector<Camera> published = out.truth;
    for (std::size_t c = 0; c < published.size(); ++c)
        published[c] = studio::bumped_camera(published[c], {0, 0.004, 0}, {0.01, 0, 0});
    oneapi::tbb::parallel_for(std::size_t{0}, out.truth.size(), [&](std::size_t c) {
        const Camera& camera = out.truth[c];
        const auto images = folder / camera.name, empty_room = folder / (camera.name + "_empty");
        const Image empty = wall(camera, 0);
        for (int i = 0; i < 2; ++i) write_image(wall(camera, i), empty_room / fmt::format("{:04}.ppm", i));
        for (int m = 0; m < kMoments; ++m) {
            const Rigid3 pose = m < 3 ? on_floor()
                                      : studio::held_board(out.truth, {-0.7, -0.7, 0.6}, {0.7, 0.7, 1.6},
                                                           {0.48, 0.40, 0}, m, 5);
            write_image(studio::draw_print(empty, camera, print, pose, 1.4,
                                           static_cast<std::uint32_t>(97 * m + 7 * c)),
                        images / fmt::format("{:04}.ppm", m));
        }
    });
    for (const Camera& camera : out.truth)
        session.cameras.push_back({camera.name, folder / camera.name, folder / (camera.name + "_empty")});
    must(write_calibration_toml(published, session.calibration));
    must(write_session(session, out.session));
    return out;
}

}  // namespace kinevox::testing
