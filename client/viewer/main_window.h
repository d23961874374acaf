// The main window: scene in the centre, angles on the right, cameras and recordings below, and a status line.
#pragma once

#include <QElapsedTimer>
#include <QMainWindow>
#include <QString>
#include <QStringList>
#include <QTimer>
#include <functional>
#include <memory>

#include "client/lib/client_program.h"
#include "client/viewer/curves.h"
#include "client/viewer/feed.h"
#include "client/viewer/subjects.h"
#include "client/viewer/theme.h"

class QAction;
class QDockWidget;
class QLabel;
class QListWidget;

namespace kinevox::viewer {

class AnglePanel;
class Calibration;
class CalibrationPanel;
class CameraPanel;
class Commands;
class Ghost;
class GhostBar;
class ReplayBar;
class SceneView;

class MainWindow final : public QMainWindow {
    Q_OBJECT

  public:
    // `connection` must be valid: open() succeeds.
    explicit MainWindow(const client::ConnectionOptions& connection);
    ~MainWindow() override;

    // Connects to another daemon and stores the connection.
    void connect_to(const client::ConnectionOptions& connection);

    SceneView& scene() { return *scene_; }
    AnglePanel& angles() { return *angles_; }
    CalibrationPanel& calibration() { return *calibration_panel_; }
    v1::WatchProcedureResponse calibration_progress() const;
    const Feed& feed() const { return *feed_; }
    const Subjects& subjects() const { return subjects_; }
    Ghost& ghost() { return *ghost_; }
    QString status_line() const;  // state, line and remedy as shown
    QString latest_message() const { return latest_message_; }

    void save_plots_in(const QString& folder);
    // An image of the window with the scene.
    QImage screenshot();

  protected:
    void closeEvent(QCloseEvent* event) override;

  private:
    void make_docks();
    void make_actions();
    void make_view_actions();
    void make_ghost_actions();
    void make_replay_actions();
    QAction* make_action(QMenu* menu, const char* name, const QString& text, const QKeySequence& key,
                         std::function<void()> act);
    QAction* make_toggle(QMenu* menu, const char* name, const QString& text, const QKeySequence& key, bool on,
                         std::function<void(bool)> act);
    void connect_feed();
    void connect_commands();
    void take_event(int kind, const QString& message, qint64 time_ns, quint32 subject_id);
    void take_volume();
    void take_poses();
    void change_subjects(const std::function<void(Subjects&)>& change);
    void show_pose_of_selected();
    void take_state();
    void show_panels();
    void show_panels_soon();
    void show_status();
    void set_dark(bool dark);
    void set_previews(PreviewKind kind);
    void show_connect_dialog();
    void save_screenshot();
    void save_plots();
    void learn_background();
    void mark();
    void show_keys();
    void show_message(const QString& message, bool ok);
    void report_busy_unless(bool accepted);
    void replay_recording(const QString& name);

    std::unique_ptr<Feed> feed_;
    std::unique_ptr<Commands> commands_;
    std::unique_ptr<Calibration> calibration_;
    std::unique_ptr<Ghost> ghost_;
    std::shared_ptr<const ShownPoses> latest_poses_;
    Subjects subjects_;
    PlotMarks marks_;
    Theme theme_;

    SceneView* scene_ = nullptr;
    QWidget* scene_widget_ = nullptr;
    AnglePanel* angles_ = nullptr;
    CameraPanel* cameras_ = nullptr;
    CalibrationPanel* calibration_panel_ = nullptr;
    QDockWidget* calibration_dock_ = nullptr;
    ReplayBar* replay_ = nullptr;
    GhostBar* ghost_bar_ = nullptr;
    QMenu *capture_menu_ = nullptr, *view_menu_ = nullptr, *ghost_menu_ = nullptr;
    QListWidget* recordings_ = nullptr;
    QLabel *state_label_ = nullptr, *line_label_ = nullptr, *remedy_label_ = nullptr;
    QAction *start_ = nullptr, *record_ = nullptr, *save_buffer_ = nullptr;
    PreviewKind preview_kind_ = PreviewKind::kImages;
    bool running_ = false, recording_ = false, angles_changed_ = false, previews_changed_ = false;
    QString latest_message_;
    QTimer panels_due_, status_due_;
    QElapsedTimer message_age_, panels_age_;
};

}  // namespace kinevox::viewer
