// The view of the scene: orbits a target, z up.
#pragma once

#include <QMatrix4x4>
#include <QVector3D>

namespace kinevox::viewer {

enum class View { kFront, kSide, kTop, kOblique };

// Angles in degrees, lengths in metres, world frame. Azimuth 0 looks along -x (the front of a person facing
// +x), anticlockwise from above.
struct OrbitCamera {
    static constexpr float kMinDistance_m = 0.3f, kMaxDistance_m = 60.f, kMaxElevation_deg = 89.f;
    static constexpr float kFieldOfView_deg = 40.f;  // vertical

    QVector3D target_in_world{0, 0, 0.95f};
    float azimuth_deg = 35, elevation_deg = 12, distance_m = 4.5f;

    QVector3D eye_in_world() const;
    QMatrix4x4 eye_from_world() const;
    // Clip space of OpenGL.
    QMatrix4x4 clip_from_eye(float width_over_height) const;
    // Screen pixels per metre at a depth of one metre.
    static float pixels_per_metre(float height_px);

    void orbit(float right_px, float down_px);
    // Moves the target so that the scene follows the pointer.
    void pan(float right_px, float down_px, float height_px);
    // One step of a mouse wheel is 1.
    void zoom(float steps);
    // Looks at the target from that side; target and distance stay.
    void look_from(View view);
    // Moves the target towards the point, smoothed. `seconds` since the previous call.
    void follow(const QVector3D& point_in_world, float seconds);
};

}  // namespace kinevox::viewer
