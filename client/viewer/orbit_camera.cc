#include <algorithm>
#include <cmath>
#include <numbers>

#include "client/viewer/scene_painter.h"

namespace kinevox::viewer {
namespace {

constexpr float kDegreesPerPixel = 0.35f, kZoomPerStep = 0.88f, kFollowTime_s = 0.25f;

float radians(float degrees) {
    return degrees * std::numbers::pi_v<float> / 180;
}

}  // namespace

QVector3D OrbitCamera::eye_in_world() const {
    const float a = radians(azimuth_deg), e = radians(elevation_deg);
    return target_in_world +
           distance_m * QVector3D(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e));
}

QMatrix4x4 OrbitCamera::eye_from_world() const {
    QMatrix4x4 m;
    m.lookAt(eye_in_world(), target_in_world, {0, 0, 1});
    return m;
}

QMatrix4x4 OrbitCamera::clip_from_eye(float width_over_height) const {
    QMatrix4x4 m;
    m.perspective(kFieldOfView_deg, width_over_height, 0.05f, 2 * kMaxDistance_m);
    return m;
}

float OrbitCamera::pixels_per_metre(float height_px) {
    return height_px / 2 / std::tan(radians(kFieldOfView_deg / 2));
}

void OrbitCamera::orbit(float right_px, float down_px) {
    azimuth_deg = std::remainder(azimuth_deg - kDegreesPerPixel * right_px, 360.f);
    elevation_deg =
        std::clamp(elevation_deg + kDegreesPerPixel * down_px, -kMaxElevation_deg, kMaxElevation_deg);
}

void OrbitCamera::pan(float right_px, float down_px, float height_px) {
    const QMatrix4x4 m = eye_from_world();
    const QVector3D right(m(0, 0), m(0, 1), m(0, 2)), up(m(1, 0), m(1, 1), m(1, 2));
    const float metres = distance_m / pixels_per_metre(height_px);
    target_in_world += metres * (down_px * up - right_px * right);
}

void OrbitCamera::zoom(float steps) {
    distance_m = std::clamp(distance_m * std::pow(kZoomPerStep, steps), kMinDistance_m, kMaxDistance_m);
}

void OrbitCamera::look_from(View view) {
    switch (view) {
        case View::kFront:
            azimuth_deg = 0, elevation_deg = 0;
            break;
        case View::kSide:
            azimuth_deg = -90, elevation_deg = 0;
            break;
        case View::kTop:
            azimuth_deg = -90, elevation_deg = kMaxElevation_deg;
            break;
        case View::kOblique:
            azimuth_deg = 35, elevation_deg = 12;
            break;
    }
}

void OrbitCamera::follow(const QVector3D& point, float seconds) {
    target_in_world += (1 - std::exp(-seconds / kFollowTime_s)) * (point - target_in_world);
}

}  // namespace kinevox::viewer
