// The scene as a widget: mouse and wheel turn, move and near it; the newest volume and skeleton are painted whenever one
// came, at most sixty times a second.
#pragma once

#include <QElapsedTimer>
#include <QOpenGLWidget>
#include <QPoint>

#include <deque>
#include <memory>
#include <optional>

#include "client/viewer/orbit_camera.h"
#include "client/viewer/scene_painter.h"
#include "client/viewer/shown.h"

namespace kinevox::viewer {

class SceneView final : public QOpenGLWidget {
    Q_OBJECT

  public:
    explicit SceneView(QWidget* parent = nullptr);
    ~SceneView() override;

    void show_volume(std::shared_ptr<const ShownVolume> volume);
    void show_pose(std::shared_ptr<const ShownPose> pose);
    void show_ghost(std::shared_ptr<const ShownPose> pose);
    void show_cameras(std::vector<Camera> cameras);
    void show_previews(std::map<std::string, QImage> pictures);
    void set_theme(const Theme& theme);

    SceneParts& parts() { return parts_; }
    OrbitCamera& eye() { return eye_; }
    void look(Look from);
    void set_following(bool on);
    bool following() const { return following_; }

    // From a volume's capture until it was on the screen, median of the newest 128; nothing before the first. Where the
    // times are not of now, as in a replay, they are not looked at.
    std::optional<double> delay_ms() const;
    double painted_volumes_per_second() const;   // over the last second
    std::uint64_t paints() const { return paints_; }

  protected:
    void initializeGL() override;
    void paintGL() override;
    void mousePressEvent(QMouseEvent* event) override;
    void mouseMoveEvent(QMouseEvent* event) override;
    void mouseDoubleClickEvent(QMouseEvent* event) override;
    void wheelEvent(QWheelEvent* event) override;

  private:
    void close_painter();
    void swapped();

    ScenePainter painter_;
    OrbitCamera eye_;
    SceneParts parts_;
    Theme theme_ = Theme::make(true);
    bool following_ = true, theme_changed_ = true;
    // What came and is not in the graphics memory yet.
    std::shared_ptr<const ShownVolume> new_volume_;
    std::shared_ptr<const ShownPose> new_pose_, new_ghost_;
    std::optional<std::vector<Camera>> new_cameras_;
    std::optional<std::map<std::string, QImage>> new_previews_;
    std::optional<QVector3D> subject_in_world_;

    std::optional<std::int64_t> painted_capture_time_ns_;   // of the volume that the next swap shows first
    std::deque<double> delays_ms_;
    std::deque<qint64> volume_paints_ms_;
    std::uint64_t paints_ = 0;
    QElapsedTimer clock_;
    qint64 last_paint_ms_ = 0;
    QPoint grabbed_px_;
};

}  // namespace kinevox::viewer
