#include "server/cameras/studio/staging.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/degrees.h"

namespace kinevox::studio {
namespace {

constexpr double kAround_s = 24;     // time in which the board faces all cameras once
constexpr double kMaxTilt_deg = 28;  // in each of two directions

// Waves of amplitude 1 whose periods are incommensurable (powers of the golden ratio).
double wave(double time_s, int which) {
    const double period_s = 5.0 * std::pow(std::numbers::phi, 0.35 * which);
    return std::sin(2 * std::numbers::pi * (time_s / period_s + 0.37 * which));
}

// Camera centres in the order of their directions from `centre`.
std::vector<Vec3> centres_around(const std::vector<Camera>& cameras, Vec3 centre) {
    std::vector<std::pair<double, Vec3>> by_direction;
    for (const Camera& camera : cameras) {
        const Vec3 at = camera.centre_in_world();
        by_direction.emplace_back(std::atan2(at.y - centre.y, at.x - centre.x), at);
    }
    std::sort(by_direction.begin(), by_direction.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<Vec3> out;
    for (const auto& [angle, at] : by_direction) out.push_back(at);
    return out;
}

}  // namespace

std::string Staging::check(std::size_t camera_count) const {
    if (board && wand) return "board and wand are both given; choose one of them";
    if (board && board->frames_on_floor < 0)
        return "the number of frames with the board on the floor must be 0 or more";
    if (wand && (wand->along_m.size() < 2 || wand->along_m.size() > 3))
        return "a wand has two or three balls";
    if (bump && bump->camera >= camera_count)
        return fmt::format("camera {} cannot be bumped; there are {} cameras", bump->camera + 1,
                           camera_count);
    if (bump && !(bump->time_s >= 0 && std::abs(bump->rotation_deg) <= 30))
        return "a bump needs a time of 0 s or later and a rotation of at most 30 degrees";
    return {};
}

Rigid3 world_from_target(const Staging& staging, const std::vector<Camera>& cameras, std::int64_t frame,
                         double fps) {
    const Vec3 centre = 0.5 * (staging.lower + staging.upper), half = 0.5 * (staging.upper - staging.lower);
    if (staging.board && frame < staging.board->frames_on_floor) {
        // Not aligned with the world axes, so that they cannot be confused with the board's.
        const Mat3 rotation = rotation_z(radians(25));
        const Vec3 at{centre.x + 0.2, centre.y - 0.1, 0};
        return {rotation, at - rotation * staging.board->centre_in_board};
    }
    const double t = static_cast<double>(frame) / fps;
    const Vec3 position{centre.x + half.x * wave(t, 1), centre.y + half.y * wave(t, 2),
                        centre.z + half.z * wave(t, 0)};
    if (staging.wand) {
        const Mat3 rotation =
            rotation_z(2.6 * wave(t, 3) + 0.3 * t) * rotation_y(1.1 * wave(t, 4)) * rotation_x(0.5);
        return {rotation, position - rotation * Vec3{0.5 * staging.wand->along_m.back(), 0, 0}};
    }
    const std::vector<Vec3> around = centres_around(cameras, centre);
    const double legs = t / kAround_s * static_cast<double>(around.size());
    const auto now = static_cast<std::size_t>(legs);
    const Vec3 from = around[now % around.size()], to = around[(now + 1) % around.size()];
    const Vec3 towards = from + (legs - static_cast<double>(now)) * (to - from);
    const Vec3 z = normalized(towards - position), x = normalized(cross({0, 0, 1}, z)), y = cross(z, x);
    const Mat3 facing{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
    const double tilt = radians(kMaxTilt_deg);
    const Mat3 rotation =
        facing * rotation_x(tilt * wave(t, 3)) * rotation_y(tilt * wave(t, 4)) * rotation_z(0.9 * wave(t, 5));
    const Vec3 centre_in_board = staging.board ? staging.board->centre_in_board : Vec3{};
    return {rotation, position - rotation * centre_in_board};
}

Image draw_target(const Staging& staging, const Image& image, const Camera& camera,
                  const Rigid3& world_from_target, double noise_grey, std::uint32_t seed) {
    if (staging.board)
        return draw_print(image, camera, staging.board->print, world_from_target, noise_grey, seed);
    if (!staging.wand) return image;
    std::vector<Ball> balls;
    for (const double along : staging.wand->along_m)
        balls.push_back({world_from_target * Vec3{along, 0, 0}, staging.wand->radius_m, 250});
    return draw_balls(image, camera, balls, noise_grey, seed);
}

Camera camera_after_bump(const CameraBump& bump, const std::vector<Camera>& cameras) {
    const double angle = radians(bump.rotation_deg) * std::numbers::sqrt2 / 2;
    return bumped_camera(cameras[bump.camera], {angle, angle, 0}, {});
}

}  // namespace kinevox::studio
