#include "tests/support/small_session.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <random>
#include <stdexcept>

#include "client/lib/image.h"
#include "common/calibration_file.h"
#include "common/session_file.h"
#include "tests/support/person_volume.h"

namespace kinevox::testing {
namespace {

void must(const absl::Status& status) {
    if (!status.ok()) throw std::runtime_error(std::string(status.message()));
}

// On a circle of four metres, two metres up, looking at the person's waist.
Camera camera_at(int index, const SmallSession& what) {
    const double angle = 0.4 + index * M_PI / 2;
    const Vec3 centre{4 * std::cos(angle), 4 * std::sin(angle), 2};
    const Vec3 forward = normalized(Vec3{0, 0, 0.9} - centre);
    const Vec3 right = normalized(cross(forward, Vec3{0, 0, 1}));
    const Vec3 down = cross(forward, right);
    Camera camera;
    camera.name = fmt::format("cam{}", index + 1);
    camera.width = what.width;
    camera.height = what.height;
    camera.fx = camera.fy = 1.1 * what.width;
    camera.cx = 0.5 * (what.width - 1);
    camera.cy = 0.5 * (what.height - 1);
    camera.camera_from_world.rotation.m = {right.x, right.y,   right.z,   down.x,   down.y,
                                           down.z,  forward.x, forward.y, forward.z};
    camera.camera_from_world.translation = -(camera.camera_from_world.rotation * centre);
    return camera;
}

client::Image with_noise(client::Image image, std::mt19937& random) {
    for (std::uint8_t& value : image.data)
        value = static_cast<std::uint8_t>(std::min<int>(255, value + static_cast<int>(random() % 5)));
    return image;
}

}  // namespace

std::filesystem::path write_small_session(const std::filesystem::path& folder, const SmallSession& what) {
    constexpr int kEmptyImages = 8;
    const Volume person = person_volume(0.03);
    client::RenderOptions room;
    room.background = {90, 110, 96};
    room.floor_grid = false;
    std::mt19937 random(7);
    Session session{"small", what.fps, folder / "calibration.toml", {}, {}};
    std::vector<Camera> cameras;
    for (int c = 0; c < 4; ++c) {
        const Camera camera = camera_at(c, what);
        const auto images = folder / camera.name, background = folder / (camera.name + "_empty");
        for (int i = 0; i < kEmptyImages; ++i)
            must(client::write_png(with_noise(client::render_volume({}, camera, room), random),
                                   background / fmt::format("{:04}.png", i)));
        for (int i = 0; i < what.frames; ++i) {
            Volume moved = person;
            moved.grid.origin_in_world.x +=
                0.4 * std::sin(2 * M_PI * i / what.frames);  // so that it loops smoothly
            must(client::write_png(with_noise(client::render_volume(moved, camera, room), random),
                                   images / fmt::format("{:04}.png", i)));
        }
        session.cameras.push_back({camera.name, images, background});
        cameras.push_back(camera);
    }
    must(write_calibration_toml(cameras, session.calibration));
    must(write_session(session, folder / "session.toml"));
    return folder / "session.toml";
}

}  // namespace kinevox::testing
