// The scene, in a native window inside the main window: a widget would be recomposed with all others for
// every frame, which without a graphics card takes four times as long as drawing. Mouse and wheel rotate, pan
// and zoom, a click selects a subject; it is painted when a volume arrives or the view changes.
#pragma once

#include <QElapsedTimer>
#include <QOpenGLWindow>
#include <QPoint>
#include <QTimer>
#include <deque>
#include <memory>
#include <optional>

#include "client/viewer/scene_painter.h"
#include "client/viewer/shown.h"

namespace kinevox::viewer {

class SceneView final : public QOpenGLWindow {
    Q_OBJECT

  public:
    SceneView();
    ~SceneView() override;

    void show_volume(std::shared_ptr<const ShownVolume> volume);
    void show_poses(std::shared_ptr<const ShownPoses> poses);
    void show_ghost(std::shared_ptr<const ShownPose> pose);
    void show_subjects(const SceneSubjects& subjects);
    void show_cameras(std::vector<Camera> cameras);
    void show_previews(std::map<std::string, QImage> images);
    void set_theme(const Theme& theme);

    SceneItems& items() { return items_; }
    OrbitCamera& eye() { return eye_; }
    void look_from(View view);
    void set_following(bool on);

    // From the capture of a volume to its display, median of the latest 128; empty before the first. Ignores
    // times that are not current, as in a replay.
    std::optional<double> latency_ms() const;
    double painted_volumes_per_second() const;  // over the last ten seconds
    std::uint64_t paints() const { return paints_; }

  signals:
    void subject_clicked(quint32 id);

  protected:
    void initializeGL() override;
    void paintGL() override;
    void mousePressEvent(QMouseEvent* event) override;
    void mouseMoveEvent(QMouseEvent* event) override;
    void mouseReleaseEvent(QMouseEvent* event) override;
    void mouseDoubleClickEvent(QMouseEvent* event) override;
    void wheelEvent(QWheelEvent* event) override;

  private:
    void close_painter();
    void swapped();
    void find_followed();
    void paint_names();
    // Paints with the next volume, or after a pause without one.
    void update_soon();

    ScenePainter painter_;
    OrbitCamera eye_;
    SceneItems items_;
    Theme theme_ = Theme::make(true);
    bool following_ = true, theme_changed_ = true;
    // Received, not in graphics memory yet.
    std::shared_ptr<const ShownVolume> new_volume_;
    std::shared_ptr<const ShownPoses> new_poses_;
    std::shared_ptr<const ShownPose> new_ghost_;
    std::optional<std::vector<Camera>> new_cameras_;
    std::optional<std::map<std::string, QImage>> new_previews_;
    // The latest, for clicks.
    std::shared_ptr<const ShownVolume> volume_;
    std::shared_ptr<const ShownPoses> poses_;
    SceneSubjects subjects_;
    std::optional<QVector3D> subject_in_world_;  // the followed one

    std::optional<std::int64_t> painted_capture_time_ns_;  // of the volume that the next swap shows first
    std::deque<double> latencies_ms_;
    std::deque<qint64> volume_paints_ms_;
    std::uint64_t paints_ = 0;
    QElapsedTimer clock_;
    qint64 last_paint_ms_ = 0;
    QPoint grabbed_px_, pressed_px_;
    QTimer due_;
};

}  // namespace kinevox::viewer
