// The scene, in a native window of its own inside the coach's: as a widget it would be put together with all
// others for each picture, which takes four times as long as drawing it where there is no graphics card.
// Mouse and wheel turn, move and near it; it is painted whenever a volume came or something moved, with the
// newest of all else.
#pragma once

#include <QElapsedTimer>
#include <QOpenGLWindow>
#include <QPoint>
#include <QTimer>
#include <deque>
#include <memory>
#include <optional>

#include "client/viewer/orbit_camera.h"
#include "client/viewer/scene_painter.h"
#include "client/viewer/shown.h"

namespace kinevox::viewer {

class SceneView final : public QOpenGLWindow {
    Q_OBJECT

  public:
    SceneView();
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

    // From a volume's capture until it was on the screen, median of the newest 128; nothing before the first.
    // Where the times are not of now, as in a replay, they are not looked at.
    std::optional<double> delay_ms() const;
    double painted_volumes_per_second() const;  // over the last ten seconds
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
    // With the next volume, or by itself if none comes.
    void update_soon();

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

    std::optional<std::int64_t> painted_capture_time_ns_;  // of the volume that the next swap shows first
    std::deque<double> delays_ms_;
    std::deque<qint64> volume_paints_ms_;
    std::uint64_t paints_ = 0;
    QElapsedTimer clock_;
    qint64 last_paint_ms_ = 0;
    QPoint grabbed_px_;
    QTimer due_;
};

}  // namespace kinevox::viewer
