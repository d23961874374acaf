#include "server/cameras/studio/staging.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "common/degrees.h"

namespace kinevox::studio {
namespace {

constexpr double kAround_s = 24;     // in which the board has faced all cameras once
constexpr double kMaxTilt_deg = 28;  // away from them, in each of two directions

// A wave of 1 that no other of these repeats together with: periods by the golden ratio.
double wave(double time_s, int which) {
    const double period_s = 5.0 * std::pow(std::numbers::phi, 0.35 * which);
    return std::sin(2 * std::numbers::pi * (time_s / period_s + 0.37 * which));
}

// Camera centres in the order of their directions from `middle`.
std::vector<Vec3> centres_around(const std::vector<Camera>& cameras, Vec3 middle) {
    std::vector<std::pair<double, Vec3>> by_direction;
    for (const Camera& camera : cameras) {
        const Vec3 at = camera.centre_in_world();
        by_direction.emplace_back(std::atan2(at.y - middle.y, at.x - middle.x), at);
    }
    std::sort(by_direction.begin(), by_direction.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<Vec3> out;
    for (const auto& [angle, at] : by_direction) out.push_back(at);
    return out;
}

}  // namespace

std::string Staging::check(std::size_t cameras) const {
    if (board && wand) return "a board and a wand at once; show one of them";
    if (board && board->frames_on_floor < 0) return "frames on the floor must be 0 or more";
    if (wand && (wand->along_m.size() < 2 || wand->along_m.size() > 3))
        return "a wand has two or three balls";
    if (knock && knock->camera >= cameras)
        return fmt::format("camera {} is to be knocked and there are {}", knock->camera + 1, cameras);
    if (knock && !(knock->time_s >= 0 && std::abs(knock->turn_deg) <= 30))
        return "a camera is knocked at 0 s or later, by 30 degrees at most";
    return {};
}

Rigid3 world_from_prop(const Staging& staging, const std::vector<Camera>& cameras, std::int64_t frame,
                       double fps) {
    const Vec3 middle = 0.5 * (staging.lower + staging.upper), half = 0.5 * (staging.upper - staging.lower);
    if (staging.board && frame < staging.board->frames_on_floor) {
        // Not along the world's axes, so that nobody takes those for the board's by chance.
        const Mat3 turn = rotation_z(radians(25));
        const Vec3 at{middle.x + 0.2, middle.y - 0.1, 0};
        return {turn, at - turn * staging.board->middle_in_board};
    }
    const double t = static_cast<double>(frame) / fps;
    const Vec3 place{middle.x + half.x * wave(t, 1), middle.y + half.y * wave(t, 2),
                     middle.z + half.z * wave(t, 0)};
    if (staging.wand) {
        const Mat3 rotation =
            rotation_z(2.6 * wave(t, 3) + 0.3 * t) * rotation_y(1.1 * wave(t, 4)) * rotation_x(0.5);
        return {rotation, place - rotation * Vec3{0.5 * staging.wand->along_m.back(), 0, 0}};
    }
    const std::vector<Vec3> around = centres_around(cameras, middle);
    const double turns = t / kAround_s * static_cast<double>(around.size());
    const auto now = static_cast<std::size_t>(turns);
    const Vec3 from = around[now % around.size()], to = around[(now + 1) % around.size()];
    const Vec3 towards = from + (turns - static_cast<double>(now)) * (to - from);
    const Vec3 z = normalized(towards - place), x = normalized(cross({0, 0, 1}, z)), y = cross(z, x);
    const Mat3 facing{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
    const double tilt = radians(kMaxTilt_deg);
    const Mat3 rotation =
        facing * rotation_x(tilt * wave(t, 3)) * rotation_y(tilt * wave(t, 4)) * rotation_z(0.9 * wave(t, 5));
    const Vec3 middle_in_board = staging.board ? staging.board->middle_in_board : Vec3{};
    return {rotation, place - rotation * middle_in_board};
}

Picture draw_prop(const Staging& staging, const Picture& picture, const Camera& camera,
                  const Rigid3& world_from_prop, double noise_grey, std::uint32_t seed) {
    if (staging.board)
        return draw_print(picture, camera, staging.board->print, world_from_prop, noise_grey, seed);
    if (!staging.wand) return picture;
    std::vector<Ball> balls;
    for (const double along : staging.wand->along_m)
        balls.push_back({world_from_prop * Vec3{along, 0, 0}, staging.wand->radius_m, 250});
    return draw_balls(picture, camera, balls, noise_grey, seed);
}

Camera after_knock(const Knock& knock, const std::vector<Camera>& cameras) {
    const double part = radians(knock.turn_deg) * std::numbers::sqrt2 / 2;
    return knocked(cameras[knock.camera], {part, part, 0}, {});
}

}  // namespace kinevox::studio
