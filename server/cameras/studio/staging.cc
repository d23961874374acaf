#include "server/cameras/studio/staging.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <optional>
#include <utility>

#include "common/geometry.h"
#include "server/cameras/studio/hash_noise.h"

namespace kinevox::studio {
namespace {

constexpr int kSamples = 3;  // per side of a pixel

struct Box {
    int x0, y0, x1, y1;
};

float gaussian(std::uint32_t a, std::uint32_t b, std::uint32_t seed) {
    const float radius = std::sqrt(-2.0f * std::log(hash_unit(a, b, seed) + 3e-8f));
    return radius * std::cos(6.2831853f * hash_unit(a, b, seed + 1));
}

// A copy whose pixels in `box` are blended with the values of `sample` (grey level of an image point, or
// nothing).
template <class Sample>
Image paint(const Image& image, Box box, double noise_grey, std::uint32_t seed, const Sample& sample) {
    const std::size_t bytes = static_cast<std::size_t>(image.width) * image.height * image.channels;
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[bytes]);
    std::memcpy(data.get(), image.data.get(), bytes);
    box = {std::max(box.x0, 0), std::max(box.y0, 0), std::min(box.x1, image.width),
           std::min(box.y1, image.height)};
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) {
            double sum = 0;
            int hits = 0;
            for (int s = 0; s < kSamples * kSamples; ++s) {
                const Vec2 at{x - 0.5 + (s % kSamples + 0.5) / kSamples,
                              y - 0.5 + (s / kSamples + 0.5) / kSamples};
                if (const std::optional<double> grey = sample(at)) sum += *grey, ++hits;
            }
            if (hits == 0) continue;
            const double coverage = static_cast<double>(hits) / (kSamples * kSamples);
            std::uint8_t* const pixel =
                &data[(static_cast<std::size_t>(y) * image.width + x) * image.channels];
            const double noise =
                noise_grey * gaussian(static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), seed);
            for (int c = 0; c < image.channels; ++c)
                pixel[c] = static_cast<std::uint8_t>(
                    std::clamp((1 - coverage) * pixel[c] + coverage * (sum / hits + noise), 0.0, 255.0));
        }
    return {image.width, image.height, image.channels, std::move(data)};
}

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

Image draw_print(const Image& image, const Camera& camera, const Print& print, const Rigid3& world_from_board,
                 double noise_grey, std::uint32_t seed) {
    const Rigid3 board_from_world = world_from_board.inverse();
    const Vec3 eye = board_from_world * camera.centre_in_world();
    if (eye.z <= 0) return image;  // behind the print
    Box box{1 << 20, 1 << 20, -1, -1};
    for (int i = 0; i < 40; ++i) {  // along the print's edge, which the lens distorts
        const double s = (i % 10) / 10.0;
        const double u = i / 10 == 0 ? s : i / 10 == 1 ? 1 : i / 10 == 2 ? 1 - s : 0;
        const double v = i / 10 == 0 ? 0 : i / 10 == 1 ? s : i / 10 == 2 ? 1 : 1 - s;
        const Vec3 corner{(u * print.grey.width - print.origin_px.x) / print.pixels_per_m,
                          (print.origin_px.y - v * print.grey.height) / print.pixels_per_m, 0};
        const auto seen = camera.project(world_from_board * corner);
        if (!seen) return image;
        box = {
            std::min(box.x0, static_cast<int>(seen->x) - 3), std::min(box.y0, static_cast<int>(seen->y) - 3),
            std::max(box.x1, static_cast<int>(seen->x) + 4), std::max(box.y1, static_cast<int>(seen->y) + 4)};
    }
    box = {std::max(box.x0, 0), std::max(box.y0, 0), std::min(box.x1, image.width),
           std::min(box.y1, image.height)};
    if (box.x0 >= box.x1 || box.y0 >= box.y1) return image;
    // Texture coordinates (px) where the rays through the pixel corners hit the print, interpolated linearly
    // in between. NaN: no hit.
    const int columns = box.x1 - box.x0 + 1, rows = box.y1 - box.y0 + 1;
    std::vector<Vec2> hits(static_cast<std::size_t>(columns) * rows, {std::nan(""), std::nan("")});
    for (int row = 0; row < rows; ++row)
        for (int column = 0; column < columns; ++column) {
            const Ray ray = camera.ray_through({box.x0 + column - 0.5, box.y0 + row - 0.5});
            const Vec3 along = board_from_world.rotation * ray.direction_in_world;
            if (along.z >= 0) continue;
            const Vec3 hit = eye + (-eye.z / along.z) * along;
            hits[static_cast<std::size_t>(row) * columns + column] = {
                hit.x * print.pixels_per_m + print.origin_px.x - 0.5,
                print.origin_px.y - hit.y * print.pixels_per_m - 0.5};
        }
    return paint(image, box, noise_grey, seed, [&](Vec2 at) -> std::optional<double> {
        const double right = at.x + 0.5 - box.x0, down = at.y + 0.5 - box.y0;
        const int column = static_cast<int>(right), row = static_cast<int>(down);
        const double s = right - column, t = down - row;
        const Vec2* const above = &hits[static_cast<std::size_t>(row) * columns + column];
        const Vec2* const below = above + columns;
        const Vec2 a0 = above[0], a1 = above[1], b0 = below[0], b1 = below[1];
        const double u = (1 - t) * ((1 - s) * a0.x + s * a1.x) + t * ((1 - s) * b0.x + s * b1.x);
        const double v = (1 - t) * ((1 - s) * a0.y + s * a1.y) + t * ((1 - s) * b0.y + s * b1.y);
        if (!(u >= 0 && v >= 0 && u < print.grey.width - 1 && v < print.grey.height - 1)) return std::nullopt;
        const auto texel = [&](int x, int y) {
            return static_cast<double>(print.grey.data[static_cast<std::size_t>(y) * print.grey.width + x]);
        };
        const int x = static_cast<int>(u), y = static_cast<int>(v);
        const double a = u - x, b = v - y;
        const double grey = (1 - b) * ((1 - a) * texel(x, y) + a * texel(x + 1, y)) +
                            b * ((1 - a) * texel(x, y + 1) + a * texel(x + 1, y + 1));
        return 25 + 0.8 * grey;  // paper and ink
    });
}

Image draw_balls(const Image& image, const Camera& camera, const std::vector<Ball>& balls, double noise_grey,
                 std::uint32_t seed) {
    Image out = image;
    const Vec3 eye = camera.centre_in_world();
    for (const Ball& ball : balls) {
        const auto seen = camera.project(ball.centre_in_world);
        if (!seen) continue;
        const double distance = norm(ball.centre_in_world - eye);
        const int radius_px = static_cast<int>(1.5 * camera.fx * ball.radius_m / distance) + 3;
        const int x = static_cast<int>(seen->x), y = static_cast<int>(seen->y);
        if (x < -radius_px || y < -radius_px || x > image.width + radius_px || y > image.height + radius_px)
            continue;
        out = paint(out, {x - radius_px, y - radius_px, x + radius_px + 1, y + radius_px + 1}, noise_grey,
                    seed++, [&](Vec2 at) -> std::optional<double> {
                        const Vec3 along = camera.ray_through(at).direction_in_world;
                        const Vec3 to = ball.centre_in_world - eye;
                        const double off = norm(to - dot(to, along) * along);
                        if (off > ball.radius_m) return std::nullopt;
                        return static_cast<double>(ball.grey);
                    });
    }
    return out;
}

Camera bumped_camera(const Camera& camera, Vec3 rotation, Vec3 shift_in_world) {
    Camera out = camera;
    const Vec3 centre = camera.centre_in_world() + shift_in_world;
    out.camera_from_world.rotation = rotation_from_rodrigues(rotation) * camera.camera_from_world.rotation;
    out.camera_from_world.translation = -(out.camera_from_world.rotation * centre);
    return out;
}

Rigid3 held_board(const std::vector<Camera>& cameras, Vec3 lower, Vec3 upper, Vec3 centre_in_board, int frame,
                  std::uint32_t seed) {
    const auto draw = [&](std::uint32_t what) {
        return static_cast<double>(hash_unit(seed, static_cast<std::uint32_t>(frame), what));
    };
    const Vec3 position{lower.x + draw(1) * (upper.x - lower.x), lower.y + draw(2) * (upper.y - lower.y),
                        lower.z + draw(3) * (upper.z - lower.z)};
    // Faces a point between two neighbouring cameras, a different pair in every frame, tilted by up to 35
    // degrees.
    const std::size_t first = static_cast<std::size_t>(frame) % cameras.size();
    const std::size_t second = (first + 1) % cameras.size();
    const Vec3 target = cameras[first].centre_in_world() +
                        draw(4) * (cameras[second].centre_in_world() - cameras[first].centre_in_world());
    const Vec3 z = normalized(target - position), x = normalized(cross({0, 0, 1}, z)), y = cross(z, x);
    const Mat3 facing{{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
    constexpr double kTilt = 0.6;
    const Mat3 tilt = rotation_x(kTilt * (2 * draw(5) - 1)) * rotation_y(kTilt * (2 * draw(6) - 1)) *
                      rotation_z(2 * draw(7) - 1);
    const Mat3 rotation = facing * tilt;
    return {rotation, position - rotation * centre_in_board};
}

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
