// The eye that looks at the scene: circles around a target, z up.
#pragma once

#include <QMatrix4x4>
#include <QVector3D>

namespace kinevox::viewer {

enum class Look { kFront, kSide, kTop, kOblique };

// Angles in degrees, lengths in metres, world frame. Azimuth 0 looks along -x (the person's front where she
// faces +x), growing anticlockwise seen from above.
struct OrbitCamera {
    static constexpr float kNearest_m = 0.3f, kFarthest_m = 60.f, kSteepest_deg = 89.f;
    static constexpr float kFieldOfView_deg = 40.f;  // vertical

    QVector3D target_in_world{0, 0, 0.95f};
    float azimuth_deg = 35, elevation_deg = 12, distance_m = 4.5f;

    QVector3D eye_in_world() const;
    QMatrix4x4 eye_from_world() const;
    // Clip space of OpenGL.
    QMatrix4x4 clip_from_eye(float width_over_height) const;
    // Screen pixels a metre has at a depth of one metre.
    static float pixels_per_metre(float height_px);

    void orbit(float right_px, float down_px);
    // Moves the target with the picture under the pointer.
    void pan(float right_px, float down_px, float height_px);
    // One step of a mouse wheel is 1.
    void zoom(float steps);
    // Towards the target from that side; the target and the distance stay.
    void look(Look from);
    // Goes a part of the way to `point`, so that what moves unevenly is followed evenly. `seconds` since the
    // last call.
    void follow(const QVector3D& point_in_world, float seconds);
};

}  // namespace kinevox::viewer
