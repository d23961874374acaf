// A made-up scene for the tracker's tests: cameras around a lane and a body of ellipsoids, whose silhouettes
// are drawn ray by ray, so that truth is known and nothing of the pipeline is needed.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"

namespace kinevox::testing {

// A camera at `eye` that looks at `target`, z up in the image.
inline Camera camera_at(const std::string& name, Vec3 eye, Vec3 target, int width = 320, int height = 240,
                        double focal_px = 280) {
    const Vec3 forward = normalized(target - eye);
    const Vec3 right = normalized(cross(forward, {0, 0, 1}));
    const Vec3 down = cross(forward, right);
    Camera camera;
    camera.name = name;
    camera.width = width, camera.height = height;
    camera.fx = camera.fy = focal_px;
    camera.cx = (width - 1) / 2.0, camera.cy = (height - 1) / 2.0;
    camera.camera_from_world.rotation = {
        {right.x, right.y, right.z, down.x, down.y, down.z, forward.x, forward.y, forward.z}};
    camera.camera_from_world.translation = -(camera.camera_from_world.rotation * eye);
    return camera;
}

// Four cameras in the corners of a room of 8 x 8 m.
inline std::vector<Camera> four_cameras() {
    return {camera_at("north", {4, 4, 2.2}, {0, 0, 1}), camera_at("east", {4, -4, 1.8}, {0, 0, 1}),
            camera_at("south", {-4, -4, 2.4}, {0, 0, 1}), camera_at("west", {-4, 4, 1.6}, {0, 0, 1})};
}

struct Ellipsoid {
    Vec3 centre;  // m, world
    Vec3 radii;   // m, along the world's axes
};

// Upright, 1.7 m tall, its centre of gravity at `centre`: symmetric, so that the centre is exact.
inline std::vector<Ellipsoid> body_at(Vec3 centre) {
    return {{centre, {0.22, 0.16, 0.45}},
            {centre + Vec3{0, 0, 0.62}, {0.1, 0.1, 0.23}},
            {centre - Vec3{0, 0, 0.62}, {0.1, 0.1, 0.23}}};
}

constexpr double kStandingCentre_m = 0.86;

// A body on each point of the floor.
inline std::vector<Ellipsoid> people_at(const std::vector<Vec3>& floor_points) {
    std::vector<Ellipsoid> all;
    for (const Vec3& p : floor_points) {
        const auto body = body_at({p.x, p.y, kStandingCentre_m});
        all.insert(all.end(), body.begin(), body.end());
    }
    return all;
}

inline bool hits(const Ray& ray, const Ellipsoid& e) {
    const Vec3 o = ray.origin_in_world - e.centre, d = ray.direction_in_world;
    const Vec3 os{o.x / e.radii.x, o.y / e.radii.y, o.z / e.radii.z};
    const Vec3 ds{d.x / e.radii.x, d.y / e.radii.y, d.z / e.radii.z};
    const double along = dot(os, ds) / dot(ds, ds);
    return along < 0 && dot(os - along * ds, os - along * ds) <= 1;
}

// The pixels that the ellipsoids' bounding boxes cover. All corners must be in front of the camera or none.
inline kernels::Rect pixels_near(const Camera& camera, const std::vector<Ellipsoid>& body) {
    double u0 = 1e9, v0 = 1e9, u1 = -1e9, v1 = -1e9;
    for (const Ellipsoid& e : body)
        for (int n = 0; n < 8; ++n) {
            const auto p =
                camera.project(e.centre + Vec3{n & 1 ? e.radii.x : -e.radii.x, n & 2 ? e.radii.y : -e.radii.y,
                                               n & 4 ? e.radii.z : -e.radii.z});
            if (!p) continue;
            u0 = std::min(u0, p->x), u1 = std::max(u1, p->x), v0 = std::min(v0, p->y),
            v1 = std::max(v1, p->y);
        }
    const auto clamp_to = [](double v, int most) { return static_cast<int>(std::clamp(v, 0.0, 1.0 * most)); };
    return {clamp_to(u0 - 1, camera.width), clamp_to(v0 - 1, camera.height), clamp_to(u1 + 3, camera.width),
            clamp_to(v1 + 3, camera.height)};
}

// Sharp and loose are the same here.
inline kernels::Silhouettes silhouettes_of(const Camera& camera, const std::vector<Ellipsoid>& body) {
    kernels::Silhouettes s;
    s.width = camera.width, s.height = camera.height;
    s.sharp.assign(static_cast<std::size_t>(s.width) * s.height, 0);
    s.searched = {0, 0, s.width, s.height};
    kernels::Rect box{s.width, s.height, 0, 0};
    const kernels::Rect near = pixels_near(camera, body);  // the rest is empty
    for (int y = near.y0; y < near.y1; ++y)
        for (int x = near.x0; x < near.x1; ++x) {
            const Ray ray = camera.ray_through({static_cast<double>(x), static_cast<double>(y)});
            bool inside = false;
            for (const Ellipsoid& e : body) inside = inside || hits(ray, e);
            if (!inside) continue;
            s.sharp[static_cast<std::size_t>(y) * s.width + x] = 255;
            box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1),
                   std::max(box.y1, y + 1)};
            ++s.sharp_pixels;
        }
    s.bounds = s.sharp_pixels > 0 ? box : kernels::Rect{};
    s.loose = s.probability = s.sharp;
    return s;
}

struct Dressed {
    Vec3 at;                    // on the floor
    kernels::Colour colour[3];  // trunk, head, legs, as body_at()
};

constexpr kernels::Colour kSkin{200, 160, 140}, kRedCloth{160, 30, 40}, kGreenCloth{40, 120, 60},
    kBlueCloth{30, 40, 110};

// B, G, R; the farthest person first, so that the nearest hides the others.
inline std::vector<std::uint8_t> image_of(const Camera& camera, std::vector<Dressed> people) {
    std::vector<std::uint8_t> image(std::size_t{3} * camera.width * camera.height, 128);
    std::ranges::sort(people, [&](const Dressed& a, const Dressed& b) {
        return norm(a.at - camera.centre_in_world()) > norm(b.at - camera.centre_in_world());
    });
    for (const Dressed& person : people) {
        const auto body = body_at({person.at.x, person.at.y, kStandingCentre_m});
        for (std::size_t part = 0; part < body.size(); ++part) {
            const kernels::Silhouettes s = silhouettes_of(camera, {body[part]});
            const kernels::Colour colour = person.colour[part];
            for (std::size_t k = 0; k < s.sharp.size(); ++k)
                if (s.sharp[k])
                    image[3 * k] = colour.b, image[3 * k + 1] = colour.g, image[3 * k + 2] = colour.r;
        }
    }
    return image;
}

inline Dressed red_at(Vec3 at) {
    return {at, {kRedCloth, kSkin, kBlueCloth}};
}
inline Dressed green_at(Vec3 at) {
    return {at, {kGreenCloth, kSkin, kRedCloth}};
}
inline Dressed blue_at(Vec3 at) {
    return {at, {kBlueCloth, kSkin, kGreenCloth}};
}

inline std::vector<Vec3> points_of(const std::vector<Dressed>& people) {
    std::vector<Vec3> points;
    for (const Dressed& person : people) points.push_back(person.at);
    return points;
}

// Images of a scene, one per camera, and their pixels.
class DressedImages {
  public:
    DressedImages(const std::vector<Camera>& cameras, const std::vector<Dressed>& people) {
        for (const Camera& camera : cameras) {
            pixels_.push_back(image_of(camera, people));
            views_.push_back(
                {pixels_.back().data(), camera.width, camera.height, 3, std::ptrdiff_t{3} * camera.width});
        }
    }
    std::span<const kernels::ImageView> views() const { return views_; }

  private:
    std::vector<std::vector<std::uint8_t>> pixels_;
    std::vector<kernels::ImageView> views_;
};

}  // namespace kinevox::testing
