#include "client/viewer/scene_painter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "client/viewer/shaders.h"
#include "common/body_pose.h"

namespace kinevox::viewer {
namespace {

constexpr unsigned kProgramPointSize = 0x8642;  // GL_PROGRAM_POINT_SIZE, not in OpenGL ES
constexpr float kGrid_m = 0.5f, kFrustum_m = 0.45f, kBone_m = 0.016f, kJoint_m = 0.022f;
// Of the disc under a subject; its height keeps it visible over the floor's lines.
constexpr float kDiscRadius_m = 0.38f, kDiscRim_m = 0.035f, kDiscHeight_m = 0.004f;
constexpr int kDiscCorners = 48;
constexpr float kTint = 0.35f;  // of the colours of subjects that are not selected
constexpr int kMinFloorRadius_m = 3, kMaxFloorRadius_m = 20;

QVector3D to_qt(const Vec3& v) {
    return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

// Corners of the camera's image on a plane at `depth_m`: upper left, upper right, lower left, lower right;
// world frame. Ignores distortion.
std::array<QVector3D, 4> frustum_corners(const Camera& camera, double depth_m) {
    std::array<QVector3D, 4> corners;
    const Rigid3 world_from_camera = camera.camera_from_world.inverse();
    for (std::size_t n = 0; n < 4; ++n) {
        const double x = n % 2 ? camera.width : 0, y = n / 2 ? camera.height : 0;
        corners[n] = to_qt(world_from_camera * Vec3{(x - camera.cx) / camera.fx * depth_m,
                                                    (y - camera.cy) / camera.fy * depth_m, depth_m});
    }
    return corners;
}

}  // namespace

void ScenePainter::open() {
    initializeOpenGLFunctions();
    const auto link = [](QOpenGLShaderProgram& program, const char* vertex, const char* fragment) {
        program.addShaderFromSourceCode(QOpenGLShader::Vertex, vertex);
        program.addShaderFromSourceCode(QOpenGLShader::Fragment, fragment);
        program.link();
    };
    link(surface_, kSurfaceVertex, kSurfaceFragment);
    link(flat_, kFlatVertex, kFlatFragment);
    link(image_, kImageVertex, kImageFragment);
    make(volume_, true);
    for (Buffer* buffer : {&floor_, &frusta_, &discs_, &bones_}) make(*buffer, false);
    quads_.array.create();
}

void ScenePainter::close() {
    textures_.clear();
    for (Buffer* buffer : {&volume_, &floor_, &frusta_, &discs_, &bones_, &quads_}) {
        buffer->vertices.destroy();
        buffer->array.destroy();
    }
    surface_.removeAllShaders();
    flat_.removeAllShaders();
    image_.removeAllShaders();
}

void ScenePainter::make(Buffer& buffer, bool surface) {
    buffer.vertices.create();
    buffer.vertices.setUsagePattern(QOpenGLBuffer::DynamicDraw);
    buffer.array.create();
    const QOpenGLVertexArrayObject::Binder bound(&buffer.array);
    buffer.vertices.bind();
    const int stride = surface ? sizeof(SurfacePoint) : sizeof(LineVertex);
    const auto attribute = [&](unsigned place, int size, unsigned type, bool normalised, std::size_t offset) {
        glEnableVertexAttribArray(place);
        glVertexAttribPointer(place, size, type, normalised, stride, reinterpret_cast<const void*>(offset));
    };
    attribute(0, 3, GL_FLOAT, false, 0);
    attribute(1, 4, GL_UNSIGNED_BYTE, true, 12);
    if (surface) attribute(2, 3, GL_BYTE, true, 16);
    buffer.vertices.release();
}

void ScenePainter::fill(Buffer& buffer, const void* data, std::size_t bytes, int count) {
    buffer.vertices.bind();
    buffer.vertices.allocate(data, static_cast<int>(bytes));
    buffer.vertices.release();
    buffer.count = count;
}

void ScenePainter::fill_with(Buffer& buffer, const std::vector<LineVertex>& vertices) {
    fill(buffer, vertices.data(), vertices.size() * sizeof(LineVertex), static_cast<int>(vertices.size()));
}

void ScenePainter::set_theme(const Theme& theme) {
    theme_ = theme;
    scene_changed_ = true;
}

void ScenePainter::set_volume(const ShownVolume& volume) {
    voxel_m_ = volume.voxel_m;
    shown_subjects_ = volume.subjects;
    fill(volume_, volume.points.data(), volume.points.size() * sizeof(SurfacePoint),
         static_cast<int>(volume.points.size()));
}

void ScenePainter::set_poses(const ShownPoses& poses) {
    poses_ = poses;
}
void ScenePainter::set_ghost(const ShownPose& pose) {
    ghost_ = pose;
}

void ScenePainter::set_cameras(const std::vector<Camera>& cameras) {
    cameras_ = cameras;
    textures_.clear();
    scene_changed_ = true;
}

void ScenePainter::set_previews(const std::map<std::string, QImage>& images) {
    std::erase_if(textures_, [&](const auto& entry) { return !images.contains(entry.first); });
    for (const auto& [camera, image] : images) {
        if (image.isNull()) {
            textures_.erase(camera);
            continue;
        }
        auto& texture = textures_[camera];
        if (!texture || texture->width() != image.width() || texture->height() != image.height()) {
            texture = std::make_unique<QOpenGLTexture>(QOpenGLTexture::Target2D);
            texture->setSize(image.width(), image.height());
            texture->setFormat(QOpenGLTexture::RGBA8_UNorm);
            texture->setMinMagFilters(QOpenGLTexture::Linear, QOpenGLTexture::Linear);
            texture->setWrapMode(QOpenGLTexture::ClampToEdge);
            texture->allocateStorage();
        }
        texture->setData(QOpenGLTexture::BGRA, QOpenGLTexture::UInt8, image.constBits());
    }
}

// Covers all cameras, in whole metres, around the origin.
void ScenePainter::make_floor() {
    float radius = kMinFloorRadius_m;
    for (const Camera& camera : cameras_) {
        const QVector3D centre = to_qt(camera.centre_in_world());
        radius = std::max({radius, std::ceil(std::abs(centre.x())), std::ceil(std::abs(centre.y()))});
    }
    radius = std::min(radius, static_cast<float>(kMaxFloorRadius_m));
    std::vector<LineVertex> lines;
    const auto add = [&](float x0, float y0, float x1, float y1, const QColor& c) {
        lines.emplace_back(QVector3D(x0, y0, 0), c);
        lines.emplace_back(QVector3D(x1, y1, 0), c);
    };
    for (int n = static_cast<int>(-radius / kGrid_m); n <= static_cast<int>(radius / kGrid_m); ++n) {
        const float at = kGrid_m * static_cast<float>(n);
        const QColor& colour = n == 0 ? theme_.floor_axis : theme_.floor_lines;
        add(at, -radius, at, radius, colour);
        add(-radius, at, radius, at, colour);
    }
    fill_with(floor_, lines);
}

void ScenePainter::make_frusta() {
    std::vector<LineVertex> lines;
    const QColor& c = theme_.faint;
    const auto add = [&](const QVector3D& from, const QVector3D& to) {
        for (const QVector3D& at : {from, to}) lines.emplace_back(at, c);
    };
    for (const Camera& camera : cameras_) {
        const QVector3D centre = to_qt(camera.centre_in_world());
        const auto corners = frustum_corners(camera, kFrustum_m);
        for (const QVector3D& corner : corners) add(centre, corner);
        add(corners[0], corners[1]), add(corners[1], corners[3]), add(corners[3], corners[2]),
            add(corners[2], corners[0]);
    }
    fill_with(frusta_, lines);
}

// Bands of triangles facing the eye: wide lines are not supported everywhere.
void ScenePainter::add_bones(const ShownPose& pose, const QVector3D& eye, Skeleton kind,
                             std::vector<LineVertex>& triangles) const {
    const int alpha = kind == Skeleton::kSelected ? 235 : kind == Skeleton::kOther ? 190 : 90;
    const bool tinted = subjects_.several && kind != Skeleton::kGhost;
    const auto band = [&](const QVector3D& from, const QVector3D& to, float half_m, const QColor& c) {
        QVector3D side = QVector3D::crossProduct(to - from, eye - from);
        if (side.lengthSquared() < 1e-12f) return;
        side = half_m * side.normalized();
        const std::array corners{from - side, from + side, to - side, to + side};
        for (const std::size_t n : {0U, 1U, 2U, 2U, 1U, 3U}) triangles.emplace_back(corners[n], c, alpha);
    };
    for (const Bone& bone : kBones) {
        const auto &from = pose.joints_in_world[*joint_index(bone.from)],
                   &to = pose.joints_in_world[*joint_index(bone.to)];
        if (!from || !to) continue;
        const bool sided = bone.side == BodySide::kLeft || bone.side == BodySide::kRight;
        const QColor colour = tinted && (kind == Skeleton::kOther || !sided)
                                  ? theme_.subject(subjects_.colour(pose.subject_id))
                              : bone.side == BodySide::kLeft  ? theme_.left
                              : bone.side == BodySide::kRight ? theme_.right
                                                              : theme_.midline;
        band(to_qt(*from), to_qt(*to), kBone_m / 2, colour);
    }
    if (kind == Skeleton::kGhost) return;
    for (const auto& joint : pose.joints_in_world) {
        if (!joint) continue;
        const QVector3D at = to_qt(*joint), towards = (eye - at).normalized();
        const QVector3D up =
            QVector3D::crossProduct(QVector3D::crossProduct(towards, {0, 0, 1}), towards).normalized();
        band(at - kJoint_m / 2 * up, at + kJoint_m / 2 * up, kJoint_m / 2,
             theme_.dark ? Qt::black : Qt::white);
    }
}

// Under each of several subjects; the selected one's is filled.
std::vector<ScenePainter::LineVertex> ScenePainter::discs() const {
    std::vector<LineVertex> triangles;
    if (!subjects_.several) return triangles;
    for (const ShownSubject& subject : shown_subjects_) {
        const QColor colour = theme_.subject(subjects_.colour(subject.id));
        const QVector3D centre(static_cast<float>(subject.centre_in_world.x),
                               static_cast<float>(subject.centre_in_world.y), kDiscHeight_m);
        const auto add_ring = [&](float inner_m, float outer_m, int alpha) {
            for (int n = 0; n < kDiscCorners; ++n) {
                const auto corner = [&](int at, float radius_m) {
                    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(at) / kDiscCorners;
                    return centre + radius_m * QVector3D(std::cos(angle), std::sin(angle), 0);
                };
                const std::array corners{corner(n, inner_m), corner(n, outer_m), corner(n + 1, inner_m),
                                         corner(n + 1, outer_m)};
                for (const std::size_t c : {0U, 1U, 2U, 2U, 1U, 3U})
                    triangles.emplace_back(corners[c], colour, alpha);
            }
        };
        add_ring(kDiscRadius_m - kDiscRim_m, kDiscRadius_m, 230);
        if (subject.id == subjects_.selected) add_ring(0, kDiscRadius_m - kDiscRim_m, 90);
    }
    return triangles;
}

void ScenePainter::paint_images(const QMatrix4x4& clip_from_world) {
    image_.bind();
    image_.setUniformValue("clip_from_world", clip_from_world);
    image_.setUniformValue("image", 0);
    const QOpenGLVertexArrayObject::Binder bound(&quads_.array);
    for (const Camera& camera : cameras_) {
        const auto texture = textures_.find(camera.name);
        if (texture == textures_.end()) continue;
        const auto corners = frustum_corners(camera, kFrustum_m);
        image_.setUniformValueArray("corner", corners.data(), 4);
        texture->second->bind(0);
        glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
        texture->second->release(0);
    }
    image_.release();
}

void ScenePainter::paint_volumes(const QMatrix4x4& clip_from_eye, const QMatrix4x4& eye_from_world,
                                 float height_px) {
    if (volume_.count == 0) return;
    surface_.bind();
    surface_.setUniformValue("eye_from_world", eye_from_world);
    surface_.setUniformValue("clip_from_eye", clip_from_eye);
    surface_.setUniformValue("pixels_per_metre", OrbitCamera::pixels_per_metre(height_px));
    surface_.setUniformValue("voxel_m", static_cast<float>(voxel_m_));
    surface_.setUniformValue("min_light", theme_.dark ? 0.45f : 0.6f);
    const QOpenGLVertexArrayObject::Binder bound(&volume_.array);
    for (const ShownSubject& subject : shown_subjects_) {
        const QColor tint = theme_.subject(subjects_.colour(subject.id));
        const bool is_other = subjects_.several && subject.id != subjects_.selected;
        surface_.setUniformValue("tint",
                                 QVector4D(static_cast<float>(tint.redF()), static_cast<float>(tint.greenF()),
                                           static_cast<float>(tint.blueF()), is_other ? kTint : 0.f));
        glDrawArrays(GL_POINTS, static_cast<int>(subject.first_point), static_cast<int>(subject.point_count));
    }
    surface_.release();
}

void ScenePainter::paint(const OrbitCamera& eye, const SceneItems& items, int width_px, int height_px) {
    if (std::exchange(scene_changed_, false)) {
        make_floor();
        make_frusta();
    }
    const QColor& background = theme_.background;
    glViewport(0, 0, width_px, height_px);
    glClearColor(background.redF(), background.greenF(), background.blueF(), 1);
    glEnable(GL_DEPTH_TEST);
    glDepthMask(GL_TRUE);
    glDisable(GL_BLEND);
    glEnable(kProgramPointSize);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);

    const QMatrix4x4 eye_from_world = eye.eye_from_world();
    const float width_over_height = static_cast<float>(width_px) / static_cast<float>(std::max(1, height_px));
    const QMatrix4x4 clip_from_eye = eye.clip_from_eye(width_over_height);
    const QMatrix4x4 clip_from_world = clip_from_eye * eye_from_world;
    const auto lines = [&](Buffer& buffer, unsigned kind) {
        if (buffer.count == 0) return;
        flat_.bind();
        flat_.setUniformValue("clip_from_world", clip_from_world);
        const QOpenGLVertexArrayObject::Binder bound(&buffer.array);
        glDrawArrays(kind, 0, buffer.count);
        flat_.release();
    };
    if (items.floor) lines(floor_, GL_LINES);
    if (items.cameras) {
        lines(frusta_, GL_LINES);
        if (!textures_.empty()) paint_images(clip_from_world);
    }
    glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE);
    if (subjects_.several && (items.volume || items.skeleton)) {
        glEnable(GL_BLEND);
        fill_with(discs_, discs());
        lines(discs_, GL_TRIANGLES);
        glDisable(GL_BLEND);
    }
    if (items.volume) paint_volumes(clip_from_eye, eye_from_world, static_cast<float>(height_px));
    if (items.skeleton) {
        // Inside the body, so drawn over the volume.
        glDisable(GL_DEPTH_TEST);
        glEnable(GL_BLEND);
        std::vector<LineVertex> triangles;
        add_bones(ghost_, eye.eye_in_world(), Skeleton::kGhost, triangles);
        const auto is_other = [&](const ShownPose& pose) {
            return subjects_.several && pose.subject_id != subjects_.selected;
        };
        for (const bool other : {true, false})  // the selected one over the others
            for (const ShownPose& pose : poses_.subjects)
                if (is_other(pose) == other)
                    add_bones(pose, eye.eye_in_world(), other ? Skeleton::kOther : Skeleton::kSelected,
                              triangles);
        fill_with(bones_, triangles);
        lines(bones_, GL_TRIANGLES);
        glDisable(GL_BLEND);
    }
}

}  // namespace kinevox::viewer
