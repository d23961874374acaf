#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "server/cameras/studio/hash_noise.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::studio {
namespace {

using std::numbers::pi;

// z towards the target, x level.
Rigid3 look_at(Vec3 eye, Vec3 target) {
    const Vec3 z = normalized(target - eye), x = normalized(cross(z, {0, 0, 1})), y = cross(z, x);
    const Mat3 rotation{{x.x, x.y, x.z, y.x, y.y, y.z, z.x, z.y, z.z}};
    return {rotation, -(rotation * eye)};
}

// Points around the space that must be in view.
std::vector<Vec3> action_space(const StudioOptions& options, bool lane) {
    std::vector<Vec3> points;
    if (lane) {
        for (double x : {-1.1, 11.4})
            for (double y : {-0.5, 0.5})
                for (double z : {0.0, 1.9}) points.push_back({x, y, z});
        return points;
    }
    const bool goes_around = options.motion == "walk" || options.motion == "run";
    const double radius = options.motion == "run" ? 2.5 : goes_around ? 1.8 : 1.05;
    for (int i = 0; i < 12; ++i)
        for (double z : {-0.05, goes_around ? 1.95 : 2.3})
            points.push_back({radius * std::cos(i * pi / 6), radius * std::sin(i * pi / 6), z});
    return points;
}

struct View {
    double left = 1e9, right = -1e9, top = 1e9, bottom = -1e9;  // of x / z and y / z
};
View view_of(const Rigid3& camera_from_world, const std::vector<Vec3>& points) {
    View view;
    for (const Vec3& p : points) {
        const Vec3 c = camera_from_world * p;
        if (c.z < 0.3) continue;
        view.left = std::min(view.left, c.x / c.z);
        view.right = std::max(view.right, c.x / c.z);
        view.top = std::min(view.top, c.y / c.z);
        view.bottom = std::max(view.bottom, c.y / c.z);
    }
    return view;
}

// Aims at the centre of what of the points is visible.
void aim(Camera& camera, Vec3 eye, const std::vector<Vec3>& points) {
    for (int round = 0; round < 4; ++round) {
        const View view = view_of(camera.camera_from_world, points);
        const Vec3 axis{0.5 * (view.left + view.right), 0.5 * (view.top + view.bottom), 1};
        camera.camera_from_world = look_at(eye, camera.camera_from_world.inverse() * axis);
    }
}

}  // namespace

std::vector<Camera> cameras_as_placed(const StudioOptions& options, bool lane) {
    std::vector<Camera> cameras;
    std::vector<Vec3> points = action_space(options, lane);
    const Mat3 turn = rotation_z(radians(options.motion_yaw_deg));
    if (!lane)
        for (Vec3& p : points) p = turn * p + options.motion_shift;
    const Vec3 middle = lane ? Vec3{5.2, 0, 0.9} : Vec3{0, 0, 0.95} + options.motion_shift;
    for (const PlacedCamera& placed : options.placed_cameras) {
        Camera camera;
        camera.name = fmt::format("cam{}", cameras.size() + 1);
        camera.width = placed.width, camera.height = placed.height;
        camera.cx = 0.5 * (placed.width - 1), camera.cy = 0.5 * (placed.height - 1);
        camera.camera_from_world = look_at(placed.position_in_world, middle);
        aim(camera, placed.position_in_world, points);
        const Vec3 target =
            placed.position_in_world + norm(middle - placed.position_in_world) *
                                           (camera.camera_from_world.rotation.transposed() * Vec3{0, 0, 1});
        camera.camera_from_world = look_at(placed.position_in_world, target + placed.aim_offset);
        const Rigid3 roll{rotation_z(radians(placed.roll_deg)), {}};
        camera.camera_from_world = roll * camera.camera_from_world;
        const View view = view_of(camera.camera_from_world, points);
        const double wide = std::max(-view.left, view.right), high = std::max(-view.top, view.bottom);
        camera.fx = camera.fy =
            placed.zoom * std::min(0.49 * placed.width / wide, 0.49 * placed.height / high);
        camera.k1 = placed.k1, camera.k2 = placed.k2, camera.k3 = placed.k3;
        camera.p1 = placed.p1, camera.p2 = placed.p2;
        cameras.push_back(camera);
    }
    return cameras;
}

std::vector<Camera> ring_of_cameras(const StudioOptions& options, bool lane) {
    std::vector<Camera> cameras;
    const std::vector<Vec3> points = action_space(options, lane);
    for (int i = 0; i < options.cameras; ++i) {
        const auto draw = [&](std::uint32_t what) {
            return 2.0 * hash_unit(options.seed, i, 60 + what) - 1.0;
        };
        // Slightly uneven, so that no two cameras face each other. Along a lane two of four cameras stand
        // near its ends, where one field of view covers all of it and the runner is not small.
        const double angle = 2 * pi * (i + (lane ? 0.06 : 0.5)) / options.cameras +
                             0.16 * draw(1) * std::min(1.0, 6.0 / options.cameras);
        const Vec3 middle = lane ? Vec3{5.2, 0, 0.9} : Vec3{0, 0, 0.95};
        const double along = lane ? 10.2 : 4.25, across = lane ? 8.2 : 4.05;
        const Vec3 eye{middle.x + along * std::cos(angle), middle.y + across * std::sin(angle),
                       lane ? 2.3 + 0.4 * draw(2) : 2.25 + 0.3 * draw(2)};
        Camera camera;
        camera.name = fmt::format("cam{}", i + 1);
        camera.width = options.width;
        camera.height = options.height;
        camera.cx = 0.5 * (options.width - 1);
        camera.cy = 0.5 * (options.height - 1);
        camera.camera_from_world = look_at(eye, middle);
        aim(camera, eye, points);
        const View view = view_of(camera.camera_from_world, points);
        const double wide = std::max(-view.left, view.right), high = std::max(-view.top, view.bottom);
        camera.fx = camera.fy =
            std::floor(std::min(0.49 * options.width / wide, 0.49 * options.height / high));
        camera.k1 = options.distortion;
        camera.k2 = -0.25 * options.distortion;
        camera.p1 = 0.004 * options.distortion * draw(3);
        camera.p2 = 0.004 * options.distortion * draw(4);
        cameras.push_back(camera);
    }
    return cameras;
}

}  // namespace kinevox::studio
