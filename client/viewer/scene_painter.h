// Draws the scene with OpenGL 3.3: floor, volume, skeleton, cameras. Independent of widgets: draws into any
// framebuffer.
#pragma once

#include <QColor>
#include <QImage>
#include <QMatrix4x4>
#include <QOpenGLBuffer>
#include <QOpenGLExtraFunctions>
#include <QOpenGLShaderProgram>
#include <QOpenGLTexture>
#include <QOpenGLVertexArrayObject>
#include <QVector3D>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client/viewer/shown.h"
#include "client/viewer/theme.h"
#include "common/camera.h"

namespace kinevox::viewer {

enum class View { kFront, kSide, kTop, kOblique };

// The view of the scene: orbits a target, z up. Angles in degrees, lengths in metres, world frame. Azimuth 0
// looks along -x (the front of a person facing +x), anticlockwise from above.
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

// Which subject has its own colours of left and right among several; the others are tinted, and all stand on
// a disc of their colour.
struct SceneSubjects {
    std::uint32_t selected = 0;
    bool several = false;
    std::map<std::uint32_t, std::uint32_t> colours;  // Subjects::colours

    // Volumes may arrive before the poses that the colours are from.
    std::uint32_t colour(std::uint32_t id) const {
        const auto found = colours.find(id);
        return found == colours.end() ? id : found->second;
    }
    bool operator==(const SceneSubjects&) const = default;
};

struct SceneItems {
    bool volume = true, skeleton = true, cameras = true, floor = true;
};

// All calls need the current OpenGL context.
class ScenePainter : private QOpenGLExtraFunctions {
  public:
    void open();
    // Before the context is destroyed.
    void close();

    void set_theme(const Theme& theme);
    void set_volume(const ShownVolume& volume);
    void set_poses(const ShownPoses& poses);
    void set_subjects(const SceneSubjects& subjects) { subjects_ = subjects; }
    // Skeleton of another trial, drawn faintly; without joints: none.
    void set_ghost(const ShownPose& pose);
    void set_cameras(const std::vector<Camera>& cameras);
    void set_previews(const std::map<std::string, QImage>& images);

    // Draws into the bound framebuffer; sizes in its pixels.
    void paint(const OrbitCamera& eye, const SceneItems& items, int width_px, int height_px);

  private:
    struct LineVertex {
        QVector3D at;  // m, world
        std::uint8_t r, g, b, a;

        LineVertex(const QVector3D& position, const QColor& colour, int alpha = 255)
            : at(position),
              r(static_cast<std::uint8_t>(colour.red())),
              g(static_cast<std::uint8_t>(colour.green())),
              b(static_cast<std::uint8_t>(colour.blue())),
              a(static_cast<std::uint8_t>(alpha)) {}
    };
    static_assert(sizeof(LineVertex) == 16);

    // Vertices in graphics memory and their layout.
    struct Buffer {
        QOpenGLBuffer vertices{QOpenGLBuffer::VertexBuffer};
        QOpenGLVertexArrayObject array;
        int count = 0;
    };
    void make(Buffer& buffer, bool surface);
    void fill(Buffer& buffer, const void* data, std::size_t bytes, int count);
    void fill_with(Buffer& buffer, const std::vector<LineVertex>& vertices);
    void make_floor();
    void make_frusta();
    enum class Skeleton { kSelected, kOther, kGhost };
    // Appends to `triangles`.
    void add_bones(const ShownPose& pose, const QVector3D& eye_in_world, Skeleton kind,
                   std::vector<LineVertex>& triangles) const;
    std::vector<LineVertex> discs() const;
    void paint_images(const QMatrix4x4& clip_from_world);
    void paint_volumes(const QMatrix4x4& clip_from_eye, const QMatrix4x4& eye_from_world, float height_px);

    Theme theme_ = Theme::make(true);
    QOpenGLShaderProgram surface_, flat_, image_;
    Buffer volume_, floor_, frusta_, discs_, bones_, quads_;
    double voxel_m_ = 0.01;
    std::vector<ShownSubject> shown_subjects_;  // of the volume
    ShownPoses poses_;
    ShownPose ghost_;
    SceneSubjects subjects_;
    std::vector<Camera> cameras_;
    std::map<std::string, std::unique_ptr<QOpenGLTexture>> textures_;
    bool scene_changed_ = true;  // floor and frusta
};

}  // namespace kinevox::viewer
