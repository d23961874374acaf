// The coach's window: the scene in the middle, angles beside it, cameras and recordings below, and in the status line how
// it goes.
#pragma once

#include <QElapsedTimer>
#include <QMainWindow>
#include <QString>
#include <QStringList>
#include <QTimer>

#include <memory>

#include "client/viewer/angle_history.h"
#include "client/viewer/feed.h"
#include "client/viewer/theme.h"

class QAction;
class QLabel;
class QListWidget;

namespace kinevox::viewer {

class AnglePanel;
class CameraPanel;
class Commands;
class ReplayBar;
class SceneView;

class MainWindow final : public QMainWindow {
    Q_OBJECT

  public:
    explicit MainWindow(const QString& server);
    ~MainWindow() override;

    // Another daemon in the place of this one.
    void connect_to(const QString& server);
    // What was seen and said is forgotten by QSettings' rules: organisation Kinevox, application viewer.
    static QStringList recent_servers();

    SceneView& scene() { return *scene_; }
    AnglePanel& angles() { return *angles_; }
    const Feed& feed() const { return *feed_; }
    QString status_line() const;   // as it is shown, state, line and remedy
    QString last_answer() const { return last_answer_; }

    // The window as a picture, the scene with it.
    QImage picture();

  protected:
    void closeEvent(QCloseEvent* event) override;

  private:
    void make_docks();
    void make_actions();
    void take_volume();
    void take_poses();
    void take_state();
    void show_panels();
    void show_panels_soon();
    void show_words();
    void set_dark(bool dark);
    void set_previews(PreviewKind kind);
    void ask_for_server();
    void save_screenshot();
    void save_plots();
    void learn_background();
    void answered(const QString& message, bool good);
    void replay_recording(const QString& name);

    std::unique_ptr<Feed> feed_;
    std::unique_ptr<Commands> commands_;
    AngleHistory history_;
    Theme theme_;

    SceneView* scene_ = nullptr;
    QWidget* scene_widget_ = nullptr;
    AnglePanel* angles_ = nullptr;
    CameraPanel* cameras_ = nullptr;
    ReplayBar* replay_ = nullptr;
    QListWidget* recordings_ = nullptr;
    QLabel *state_label_ = nullptr, *line_label_ = nullptr, *remedy_label_ = nullptr;
    QAction *start_ = nullptr, *record_ = nullptr, *keep_ = nullptr;
    PreviewKind preview_kind_ = PreviewKind::kPictures;
    bool running_ = false, recording_ = false, angles_changed_ = false, previews_changed_ = false;
    QString last_answer_;
    QTimer panels_due_, words_due_;
    QElapsedTimer answer_age_, panels_age_;
};

}  // namespace kinevox::viewer
