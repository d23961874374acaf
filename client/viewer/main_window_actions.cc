// What the coach can press: toolbar, menus and keys.
#include <QAction>
#include <QActionGroup>
#include <QDateTime>
#include <QDockWidget>
#include <QFileDialog>
#include <QListWidget>
#include <QMenuBar>
#include <QMessageBox>
#include <QSettings>
#include <QStandardPaths>
#include <QToolBar>
#include <utility>

#include "client/viewer/angle_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/connect_dialog.h"
#include "client/viewer/ghost.h"
#include "client/viewer/ghost_bar.h"
#include "client/viewer/main_window.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kBackgroundFrames = 60;

}  // namespace

QAction* MainWindow::make_action(QMenu* menu, const char* name, const QString& text, const QKeySequence& key,
                                 std::function<void()> act) {
    QAction* made = menu->addAction(text);
    made->setObjectName(name);
    made->setShortcut(key);
    made->setToolTip(key.isEmpty() ? text : text + " (" + key.toString(QKeySequence::NativeText) + ")");
    connect(made, &QAction::triggered, this, [act = std::move(act)] { act(); });
    return made;
}

QAction* MainWindow::make_toggle(QMenu* menu, const char* name, const QString& text, const QKeySequence& key,
                                 bool on, std::function<void(bool)> act) {
    QAction* made = make_action(menu, name, text, key, [] {});
    made->setCheckable(true);
    made->setChecked(on);
    connect(made, &QAction::triggered, this, [act = std::move(act)](bool is_on) { act(is_on); });
    return made;
}

void MainWindow::make_actions() {
    auto* bar = addToolBar(tr("Capture"));
    bar->setObjectName("capture");
    capture_menu_ = menuBar()->addMenu(tr("&Capture"));
    view_menu_ = menuBar()->addMenu(tr("&View"));
    ghost_menu_ = menuBar()->addMenu(tr("&Ghost"));
    QMenu* help = menuBar()->addMenu(tr("&Help"));
    start_ = make_action(capture_menu_, "start", tr("Start"), Qt::Key_S, [this] {
        busy_unless(running_ ? commands_->stop_capture() : commands_->start_capture());
    });
    QAction* learn = make_action(capture_menu_, "learn", tr("Learn the empty scene"), Qt::Key_B,
                                 [this] { learn_background(); });
    record_ = make_action(capture_menu_, "record", tr("Record"), Qt::Key_R, [this] {
        record_->setEnabled(
            false);  // until it is known what came of it: pressed again it would mean the opposite
        busy_unless(recording_ ? commands_->stop_recording() : commands_->start_recording());
    });
    keep_ = make_action(capture_menu_, "keep", tr("Keep last"), Qt::Key_K,
                        [this] { busy_unless(commands_->keep_last()); });
    QAction* moment =
        make_action(capture_menu_, "mark", tr("Mark this moment"), Qt::Key_M, [this] { mark(); });
    moment->setIconText(tr("Mark"));
    QAction* calibrate = calibration_dock_->toggleViewAction();
    calibrate->setObjectName("calibrate");
    calibrate->setText(tr("Calibrate"));
    calibrate->setShortcut(Qt::Key_F2);
    calibrate->setToolTip(tr("Calibrate the cameras (F2)"));
    capture_menu_->addAction(calibrate);
    capture_menu_->addSeparator();
    make_action(capture_menu_, "connect", tr("Connect to..."), QKeySequence::Open,
                [this] { ask_for_server(); });
    make_action(capture_menu_, "screenshot", tr("Save a picture..."), QKeySequence::Save,
                [this] { save_screenshot(); });
    make_action(capture_menu_, "plots", tr("Save the plots..."), Qt::CTRL | Qt::Key_P,
                [this] { save_plots(); });
    make_action(capture_menu_, "quit", tr("Quit"), QKeySequence::Quit, [this] { close(); });
    bar->addActions({start_, learn, record_, keep_, moment, calibrate});
    bar->addSeparator();
    const auto looks = {std::tuple{"front", tr("Front"), Qt::Key_1, Look::kFront},
                        {"side", tr("Side"), Qt::Key_2, Look::kSide},
                        {"top", tr("Top"), Qt::Key_3, Look::kTop},
                        {"oblique", tr("Oblique"), Qt::Key_4, Look::kOblique}};
    for (const auto& [name, text, key, from] : looks)
        bar->addAction(make_action(view_menu_, name, text, key, [this, from = from] { scene_->look(from); }));
    make_view_actions();
    make_ghost_actions();
    make_replay_actions();
    make_action(help, "keys", tr("Keys"), QKeySequence::HelpContents, [this] { show_keys(); });
}

void MainWindow::make_view_actions() {
    QMenu* view = view_menu_;
    view->addSeparator();
    make_toggle(view, "follow", tr("Follow the athlete"), Qt::Key_F, true,
                [this](bool on) { scene_->set_following(on); });
    const auto part = [this](bool SceneParts::*which) {
        return [this, which](bool on) {
            scene_->parts().*which = on;
            scene_->update();
        };
    };
    make_toggle(view, "volume", tr("Volume"), Qt::Key_V, true, part(&SceneParts::volume));
    make_toggle(view, "skeleton", tr("Skeleton"), Qt::Key_J, true, part(&SceneParts::skeleton));
    make_toggle(view, "frusta", tr("Cameras in the scene"), Qt::Key_C, true, part(&SceneParts::cameras));
    view->addSeparator();
    auto* kinds = new QActionGroup(this);
    const auto kind = [&](const char* name, const QString& text, const QKeySequence& key, PreviewKind which) {
        kinds->addAction(make_toggle(view, name, text, key, which == preview_kind_,
                                     [this, which](bool) { set_previews(which); }));
    };
    kind("pictures", tr("Cameras' pictures"), Qt::Key_P, PreviewKind::kPictures);
    kind("silhouettes", tr("Silhouettes"), Qt::Key_O, PreviewKind::kSilhouettes);
    kind("no_pictures", tr("No pictures"), Qt::Key_N, PreviewKind::kNone);
    view->addSeparator();
    make_toggle(view, "light", tr("Light colours"), Qt::Key_L, !QSettings().value("dark", true).toBool(),
                [this](bool on) { set_dark(!on); });
    make_toggle(view, "fullscreen", tr("Full screen"), Qt::Key_F11, false,
                [this](bool on) { on ? showFullScreen() : showNormal(); });
}

void MainWindow::make_ghost_actions() {
    QMenu* menu = ghost_menu_;
    make_action(menu, "ghost", tr("The recording that is chosen in the list"), Qt::Key_G, [this] {
        const QListWidgetItem* item = recordings_->currentItem();
        if (!item) return answered(tr("choose a recording in the list first; it becomes the ghost"), false);
        ghost_->choose_recording(item->data(Qt::UserRole).toString().toStdString());
    });
    make_action(menu, "ghost_replayed", tr("What is replayed, from its mark or from here"),
                Qt::SHIFT | Qt::Key_G, [this] { ghost_->choose_replayed(); });
    make_action(menu, "ghost_file", tr("From a file..."), Qt::CTRL | Qt::Key_G, [this] {
        const QString file =
            QFileDialog::getOpenFileName(this, tr("The ghost's joints"), {}, tr("Tables (*.csv)"));
        if (!file.isEmpty()) ghost_->choose_file(file);
    });
    make_action(menu, "no_ghost", tr("No ghost"), {}, [this] { ghost_->none(); });
    menu->addSeparator();
    make_action(menu, "ghost_later", tr("Ghost back"), Qt::Key_Comma, [this] { ghost_bar_->shift(-1); });
    make_action(menu, "ghost_earlier", tr("Ghost ahead"), Qt::Key_Period, [this] { ghost_bar_->shift(1); });
}

void MainWindow::make_replay_actions() {
    connect(replay_, &ReplayBar::play, this, [this](bool on) { busy_unless(commands_->play(on)); });
    connect(replay_, &ReplayBar::step, this, [this](int frames) { busy_unless(commands_->step(frames)); });
    connect(replay_, &ReplayBar::seek, this,
            [this](qint64 frame) { commands_->seek(frame); });  // the next one counts
    connect(replay_, &ReplayBar::speed, this,
            [this](double times) { busy_unless(commands_->set_speed(times)); });
    connect(replay_, &ReplayBar::loop, this, [this](bool on) { busy_unless(commands_->set_loop(on)); });
    connect(replay_, &ReplayBar::close_replay, this, [this] { busy_unless(commands_->close_replay()); });
    const auto in_replay = [this](const QKeySequence& key, auto act) {
        auto* made = new QAction(this);
        made->setShortcut(key);
        connect(made, &QAction::triggered, this, [this, act] {
            if (replay_->isVisible()) act();
        });
        addAction(made);
    };
    in_replay(Qt::Key_Space, [this] { commands_->play(!replay_->playing()); });
    in_replay(Qt::Key_Left, [this] { commands_->step(-1); });
    in_replay(Qt::Key_Right, [this] { commands_->step(1); });
}

void MainWindow::show_keys() {
    QString text;
    for (const QMenu* menu : {capture_menu_, view_menu_, ghost_menu_})
        for (const QAction* a : menu->actions())
            if (!a->shortcut().isEmpty())
                text += QString("<tr><td><b>%1</b>&nbsp;&nbsp;</td><td>%2</td></tr>")
                            .arg(a->shortcut().toString(QKeySequence::NativeText), a->text());
    text +=
        tr("<tr><td><b>Space, Left, Right</b>&nbsp;&nbsp;</td><td>play or pause, step in a replay</td></tr>"
           "<tr><td><b>drag, Shift + drag, wheel</b>&nbsp;&nbsp;</td><td>turn, move, near</td></tr>");
    QMessageBox::information(this, tr("Keys"), "<table>" + text + "</table>");
}

// The ghost's event belongs to it, and it stands in the curves.
void MainWindow::mark() {
    const auto now_ns = history_.newest_time_ns();
    if (!now_ns) return answered(tr("there is nothing to mark: nothing was measured yet"), false);
    answered(tr("mark %1").arg(marks_.add_mark(*now_ns)), true);
    ghost_->mark();
    angles_changed_ = true;
    show_panels_soon();
}

void MainWindow::ask_for_server() {
    ConnectDialog dialog(this);
    if (dialog.exec() == QDialog::Accepted) connect_to(dialog.connection());
}

void MainWindow::save_screenshot() {
    const QImage shot = picture();  // of now, not of when the dialogue is closed
    const QString folder = QStandardPaths::writableLocation(QStandardPaths::PicturesLocation);
    const QString now = QDateTime::currentDateTime().toString("yyyy-MM-dd hh.mm.ss");
    const QString file = QFileDialog::getSaveFileName(this, tr("Save a picture"),
                                                      folder + "/kinevox " + now + ".png", "PNG (*.png)");
    if (file.isEmpty()) return;
    const bool saved = shot.save(file);
    answered(
        saved ? tr("saved as %1").arg(file) : tr("%1 cannot be written; choose another folder").arg(file),
        saved);
}

void MainWindow::save_plots() {
    const QString folder = QFileDialog::getExistingDirectory(this, tr("Where the plots go"));
    if (!folder.isEmpty()) save_plots_in(folder);
}

// Each curve as PNG, to be shown, and as PDF, to be printed.
void MainWindow::save_plots_in(const QString& folder) {
    for (int n = 0; n < AnglePanel::kCurves; ++n)
        for (const char* ending : {".png", ".pdf"}) {
            const std::string angle = angles_->choices()[static_cast<std::size_t>(AnglePanel::kNumbers + n)];
            const QString file = folder + "/" + QString::fromStdString(angle) + ending;
            if (!angles_->save_plot(n, file))
                return answered(tr("%1 cannot be written; choose another folder").arg(file), false);
        }
    answered(tr("saved in %1").arg(folder), true);
}

// A live scene is learned from what comes next; a recorded one has its own clip, for which the capture has to
// stand still.
void MainWindow::learn_background() {
    const DaemonState state = feed_->state();
    const bool running = state.status && state.status->state() == v1::CAPTURE_STATE_RUNNING;
    if (running) answered(tr("learning: leave the space empty for two seconds"), true);
    commands_->learn_background(running ? kBackgroundFrames : 0);
}

}  // namespace kinevox::viewer
