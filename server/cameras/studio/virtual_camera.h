// Lens and sensor of a virtual camera.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

// Projection with OpenCV's distortion in single precision for the inner loops (Camera uses double).
class Lens {
  public:
    explicit Lens(const Camera& c)
        : camera_(c),
          camera_from_world_(to_float(c.camera_from_world)),
          fx_(static_cast<float>(c.fx)),
          fy_(static_cast<float>(c.fy)),
          cx_(static_cast<float>(c.cx)),
          cy_(static_cast<float>(c.cy)),
          k1_(static_cast<float>(c.k1)),
          k2_(static_cast<float>(c.k2)),
          k3_(static_cast<float>(c.k3)),
          p1_(static_cast<float>(c.p1)),
          p2_(static_cast<float>(c.p2)) {
        const Rigid3 back = c.camera_from_world.inverse();
        world_from_camera_ = to_float(back);
        centre_ = to_float(back.translation);
    }
    Vec3f centre_in_world() const { return centre_; }

    // (u, v) in px and the depth along the optical axis; u, v mean nothing where depth <= 0.
    Vec3f project(Vec3f world) const {
        const Vec3f c = camera_from_world_.point(world);
        const float inv = 1.0f / c.z;
        const Vec3f d = distort(c.x * inv, c.y * inv);
        return {fx_ * d.x + cx_, fy_ * d.y + cy_, c.z};
    }
    // Direction of length 1 in the world, through the pixel (u, v).
    Vec3f direction_through(float u, float v) const {
        const float xd = (u - cx_) / fx_, yd = (v - cy_) / fy_;
        float x = xd, y = yd;
        if (k1_ != 0 || k2_ != 0 || k3_ != 0 || p1_ != 0 || p2_ != 0) {
            float step = 0;
            for (int i = 0; i < 12; ++i) {
                const Vec3f d = distort(x, y);
                const float step_x = xd - d.x, step_y = yd - d.y;
                step = std::abs(step_x) + std::abs(step_y);
                if (x + step_x == x && y + step_y == y) break;
                x += step_x;
                y += step_y;
            }
            // The corners of a wide lens, where these steps diverge.
            if (!(step < kMaxStep)) return to_float(camera_.ray_through({u, v}).direction_in_world);
        }
        return normalized(world_from_camera_.direction({x, y, 1}));
    }

  private:
    Vec3f distort(float x, float y) const {
        const float r2 = x * x + y * y, radial = 1 + r2 * (k1_ + r2 * (k2_ + r2 * k3_));
        return {x * radial + 2 * p1_ * x * y + p2_ * (r2 + 2 * x * x),
                y * radial + p1_ * (r2 + 2 * y * y) + 2 * p2_ * x * y, 0};
    }
    static constexpr float kMaxStep = 1e-5f;  // of normalized image coordinates

    Camera camera_;
    Affine3f camera_from_world_, world_from_camera_;
    Vec3f centre_;
    float fx_, fy_, cx_, cy_, k1_, k2_, k3_, p1_, p2_;
};

// From light to grey levels: flicker as gain, Gaussian read noise, 8 bits.
class Sensor {
  public:
    // shot_noise_grey: of the light itself at white, one sigma, grey levels.
    Sensor(double noise_grey, double flicker, double fps, std::uint32_t seed, double shot_noise_grey = 0);

    // Factor on light levels as the camera shows them; 1 +- flicker, the same for all pixels of a frame.
    double gain(std::uint32_t camera, std::int64_t frame) const;

    // One row: grey levels times kGreyScale to 8 bits. `row_key` chooses the noise.
    void expose(const std::uint16_t* light, int count, double gain, std::uint32_t row_key,
                std::uint8_t* out) const;

  private:
    int scaled(int level, int noise) const;

    double flicker_, fps_;
    std::uint32_t seed_;
    std::vector<std::int16_t> noise_;  // grey levels times 64, Gaussian
    std::vector<std::int32_t> scale_;  // of the noise at each grey level, times 256; empty: 1
};

}  // namespace kinevox::studio
