#include "kernels/tests/capsule_body.h"

#include <cmath>

namespace kinevox::kernels::testing {
namespace {

struct Point {
    float x, y, z, radius;
};

}  // namespace

std::vector<TaperedCapsule> capsule_person(float x0, float y0, float heading, float stride) {
    std::vector<TaperedCapsule> body;
    const float c = std::cos(heading), s = std::sin(heading);
    const auto add = [&](Point a, Point b) {
        body.push_back({{x0 + c * a.x - s * a.y, y0 + s * a.x + c * a.y, a.z},
                        {x0 + c * b.x - s * b.y, y0 + s * b.x + c * b.y, b.z},
                        a.radius,
                        b.radius});
    };
    const auto middle = [](Point a, Point b, float radius) {
        return Point{(a.x + b.x) / 2, (a.y + b.y) / 2, (a.z + b.z) / 2, radius};
    };
    const auto limb = [&](Point a, Point b, float radius) {  // thickest in the middle
        add(a, middle(a, b, radius));
        add(middle(a, b, radius), b);
    };
    for (const float side : {-1.f, 0.f, 1.f}) {
        add({0, 0.05f * side, 0.95f, 0.12f}, {0.01f, 0.05f * side, 1.1f, 0.11f});
        add({0.01f, 0.05f * side, 1.1f, 0.11f}, {0, 0.06f * side, 1.35f, 0.12f});
    }
    add({0, 0, 1.35f, 0.12f}, {0, 0, 1.5f, 0.06f});
    add({0, 0, 1.5f, 0.06f}, {0.02f, 0, 1.58f, 0.07f});
    add({0.02f, 0, 1.58f, 0.08f}, {0.02f, 0, 1.66f, 0.085f});
    add({0.05f, 0, 1.55f, 0.05f}, {0.04f, 0, 1.65f, 0.08f});
    for (const float side : {-1.f, 1.f}) {
        const float swing = side * stride;
        add({0, 0.08f * side, 1.38f, 0.1f}, {0, 0.18f * side, 1.42f, 0.055f});
        const Point shoulder{0, 0.2f * side, 1.42f, 0.055f};
        const Point elbow{0.27f * std::sin(-swing), 0.26f * side, 1.42f - 0.27f * std::cos(swing), 0.042f};
        const Point wrist{elbow.x + 0.25f * std::sin(0.4f - swing), 0.27f * side,
                          elbow.z - 0.25f * std::cos(0.4f - swing), 0.03f};
        const Point hand{wrist.x + 0.05f, 0.27f * side, wrist.z - 0.15f, 0.02f};
        limb(shoulder, elbow, 0.05f);
        limb(elbow, wrist, 0.042f);
        limb(wrist, hand, 0.035f);
        const Point hip{0, 0.1f * side, 0.92f, 0.09f};
        const Point knee{0.42f * std::sin(swing), 0.1f * side, 0.92f - 0.42f * std::cos(swing), 0.06f};
        const Point ankle{knee.x + 0.42f * std::sin(swing - 0.3f), 0.1f * side,
                          knee.z - 0.42f * std::cos(swing - 0.3f), 0.04f};
        limb(hip, knee, 0.085f);
        limb(knee, ankle, 0.06f);
        add({ankle.x - 0.04f, ankle.y, ankle.z - 0.03f, 0.04f},
            {ankle.x + 0.17f, ankle.y, ankle.z - 0.05f, 0.025f});
    }
    return body;
}

CameraModel camera_looking(const float from[3], const float at[3], int width, int height, float focal_px) {
    CameraModel camera;
    camera.width = width, camera.height = height;
    camera.fx = camera.fy = focal_px;
    camera.cx = 0.5f * static_cast<float>(width - 1), camera.cy = 0.5f * static_cast<float>(height - 1);
    float z[3] = {at[0] - from[0], at[1] - from[1], at[2] - from[2]};
    const float length = std::sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2]), flat = std::hypot(z[0], z[1]);
    for (float& value : z) value /= length;
    const float x[3] = {z[1] * length / flat, -z[0] * length / flat, 0};  // to the right: level
    const float y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]};
    const float* rows[3] = {x, y, z};
    for (int r = 0; r < 3; ++r) {
        camera.translation_camera_from_world[r] = 0;
        for (int k = 0; k < 3; ++k) {
            camera.rotation_camera_from_world[3 * r + k] = rows[r][k];
            camera.translation_camera_from_world[r] -= rows[r][k] * from[k];
        }
    }
    return camera;
}

}  // namespace kinevox::kernels::testing
