#include "kernels/tests/volume_scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <thread>

namespace kinevox::kernels::testing {
namespace {

// The ray through a pixel in the camera frame (z = 1); distortion undone by fixed-point iteration.
void undistort(const CameraModel& c, double u, double v, double& x, double& y) {
    const double xd = (u - c.cx) / c.fx, yd = (v - c.cy) / c.fy;
    x = xd, y = yd;
    for (int n = 0; n < 50; ++n) {
        const double r2 = x * x + y * y, radial = 1 + r2 * (c.k1 + r2 * (c.k2 + r2 * c.k3));
        const double dx = 2 * c.p1 * x * y + c.p2 * (r2 + 2 * x * x);
        const double dy = c.p1 * (r2 + 2 * y * y) + 2 * c.p2 * x * y;
        x = (xd - dx) / radial;
        y = (yd - dy) / radial;
    }
}

// One camera's image and mask.
void draw_camera(const CameraModel& c, const Scene::Distance& body, const Scene::Paint& paint,
                 Colour background, std::vector<std::uint8_t>& mask, std::vector<std::uint8_t>& image) {
    const std::size_t pixels = static_cast<std::size_t>(c.width) * c.height;
    mask.assign(pixels, 0);
    image.assign(3 * pixels, 0);
    const float* r = c.rotation_camera_from_world;
    const float* t = c.translation_camera_from_world;
    double centre[3];
    for (int axis = 0; axis < 3; ++axis) {
        centre[axis] = -(r[axis] * t[0] + r[3 + axis] * t[1] + r[6 + axis] * t[2]);
    }
    for (int v = 0; v < c.height; ++v) {
        for (int u = 0; u < c.width; ++u) {
            double x, y;
            undistort(c, u, v, x, y);
            const double length = std::sqrt(x * x + y * y + 1);
            float p[3];
            double s = 1;
            bool hit = false;
            for (int step = 0; step < 200 && s < 6; ++step) {
                for (int axis = 0; axis < 3; ++axis) {
                    p[axis] = static_cast<float>(centre[axis] +
                                                 s * (r[axis] * x + r[3 + axis] * y + r[6 + axis]) / length);
                }
                const float distance = body(p);
                if (distance < 1e-4f) {
                    hit = true;
                    break;
                }
                s += distance;
            }
            const std::size_t at = static_cast<std::size_t>(v) * c.width + u;
            mask[at] = hit ? 255 : 0;
            const Colour colour = hit && paint ? paint(p) : background;
            image[3 * at] = colour.b, image[3 * at + 1] = colour.g, image[3 * at + 2] = colour.r;
        }
    }
}

}  // namespace

Scene ring_of_cameras(int count, float k1, float k2, float p1) {
    Scene scene;
    for (int n = 0; n < count; ++n) {
        const double angle = 2 * std::numbers::pi * n / count + 0.2;
        const double height = 1.0 + 0.5 * std::sin(2.3 * n);
        const double centre[3] = {3 * std::cos(angle), 3 * std::sin(angle), height};
        double forward[3] = {-centre[0], -centre[1], 1 - centre[2]};
        const double length = std::hypot(forward[0], forward[1], forward[2]);
        for (double& f : forward) f /= length;
        // right = forward x up, down = forward x right
        double right[3] = {forward[1], -forward[0], 0};
        const double across = std::hypot(right[0], right[1]);
        for (double& r : right) r /= across;
        const double down[3] = {forward[1] * right[2] - forward[2] * right[1],
                                forward[2] * right[0] - forward[0] * right[2],
                                forward[0] * right[1] - forward[1] * right[0]};
        CameraModel c;
        const bool small = n % 2 == 1;
        c.width = small ? 320 : 640, c.height = small ? 240 : 480;
        c.fx = small ? 300.f : 610.f, c.fy = small ? 305.f : 600.f;
        c.cx = c.width * 0.5f - 0.7f, c.cy = c.height * 0.5f + 1.3f;
        c.k1 = k1, c.k2 = k2, c.p1 = p1, c.p2 = -0.5f * p1;
        for (int axis = 0; axis < 3; ++axis) {
            c.rotation_camera_from_world[axis] = static_cast<float>(right[axis]);
            c.rotation_camera_from_world[3 + axis] = static_cast<float>(down[axis]);
            c.rotation_camera_from_world[6 + axis] = static_cast<float>(forward[axis]);
        }
        for (int row = 0; row < 3; ++row) {
            double t = 0;
            for (int axis = 0; axis < 3; ++axis)
                t -= c.rotation_camera_from_world[3 * row + axis] * centre[axis];
            c.translation_camera_from_world[row] = static_cast<float>(t);
        }
        scene.cameras.push_back(c);
    }
    return scene;
}

void Scene::draw(const Distance& body, const Paint& paint, Colour background) {
    masks.assign(cameras.size(), {});
    images.assign(cameras.size(), {});
    std::vector<std::thread> threads;
    for (std::size_t n = 0; n < cameras.size(); ++n)
        threads.emplace_back(
            [&, n] { draw_camera(cameras[n], body, paint, background, masks[n], images[n]); });
    for (std::thread& thread : threads) thread.join();
}

std::vector<HullView> Scene::hull_views() const {
    std::vector<HullView> views;
    for (std::size_t n = 0; n < cameras.size(); ++n) {
        HullView view{&cameras[n], nullptr, {}};
        if (!masks[n].empty()) {
            view.silhouette = masks[n].data();
            Rect box{cameras[n].width, cameras[n].height, 0, 0};
            for (int v = 0; v < cameras[n].height; ++v) {
                for (int u = 0; u < cameras[n].width; ++u) {
                    if (masks[n][static_cast<std::size_t>(v) * cameras[n].width + u] == 0) continue;
                    box = {std::min(box.x0, u), std::min(box.y0, v), std::max(box.x1, u + 1),
                           std::max(box.y1, v + 1)};
                }
            }
            view.bounds = box.empty() ? Rect{} : box;
        }
        views.push_back(view);
    }
    return views;
}

std::vector<ColouringView> Scene::colouring_views() const {
    std::vector<ColouringView> views;
    for (std::size_t n = 0; n < cameras.size(); ++n) {
        ColouringView view;
        view.camera = &cameras[n];
        view.image = {images[n].data(), cameras[n].width, cameras[n].height, 3, 3 * cameras[n].width};
        if (!masks[n].empty()) view.silhouette = view.sharp = masks[n].data();
        views.push_back(view);
    }
    return views;
}

float sphere_distance(const float* p, float x, float y, float z, float radius) {
    return std::hypot(p[0] - x, p[1] - y, p[2] - z) - radius;
}

float box_distance(const float* p, float half_x, float half_y, float half_z) {
    const float d[3] = {std::fabs(p[0]) - half_x, std::fabs(p[1]) - half_y, std::fabs(p[2] - 1) - half_z};
    const float outside = std::hypot(std::max(d[0], 0.f), std::max(d[1], 0.f), std::max(d[2], 0.f));
    return outside + std::min(std::max({d[0], d[1], d[2]}), 0.f);
}

Lattice make_lattice(float voxel_m, int nx, int ny, int nz) {
    Lattice lattice;
    lattice.voxel_m = voxel_m;
    lattice.size[0] = nx, lattice.size[1] = ny, lattice.size[2] = nz;
    for (int axis = 0; axis < 3; ++axis) {
        lattice.origin[axis] =
            -0.5f * voxel_m * static_cast<float>(lattice.size[axis]) + (axis == 2 ? 1.f : 0.f);
    }
    return lattice;
}

std::vector<std::uint8_t> bits_of(const VoxelVolume& volume) {
    const int* size = volume.lattice.size;
    std::vector<std::uint8_t> out(static_cast<std::size_t>(size[0]) * size[1] * size[2], 0);
    for (const Brick& brick : volume.bricks) {
        for (int bit = 0; bit < kBrickVoxels; ++bit) {
            if (!(brick.occupancy[bit >> 6] >> (bit & 63) & 1)) continue;
            const int x = brick.x * 8 + (bit & 7), y = brick.y * 8 + (bit >> 3 & 7),
                      z = brick.z * 8 + (bit >> 6);
            out[(static_cast<std::size_t>(z) * size[1] + y) * size[0] + x] = 1;
        }
    }
    return out;
}

}  // namespace kinevox::kernels::testing
