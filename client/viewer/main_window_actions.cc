// Actions: toolbar, menus and keys.
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
#include "client/viewer/main_window.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kBackgroundFrameSets = 60;

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
        report_busy_unless(running_ ? commands_->stop_capture() : commands_->start_capture());
    });
    QAction* learn = make_action(capture_menu_, "learn", tr("Learn background"), Qt::Key_B,
                                 [this] { learn_background(); });
    record_ = make_action(capture_menu_, "record", tr("Record"), Qt::Key_R, [this] {
        record_->setEnabled(false);  // until the result is known: a second press would mean the opposite
        report_busy_unless(recording_ ? commands_->stop_recording() : commands_->start_recording());
    });
    save_buffer_ = make_action(capture_menu_, "save_buffer", tr("Save buffer"), Qt::Key_K,
                               [this] { report_busy_unless(commands_->save_buffer()); });
    QAction* mark_action = make_action(capture_menu_, "mark", tr("Set mark"), Qt::Key_M, [this] { mark(); });
    mark_action->setIconText(tr("Mark"));
    QAction* calibrate = calibration_dock_->toggleViewAction();
    calibrate->setObjectName("calibrate");
    calibrate->setText(tr("Calibrate"));
    calibrate->setShortcut(Qt::Key_F2);
    calibrate->setToolTip(tr("Calibrate the cameras (F2)"));
    capture_menu_->addAction(calibrate);
    capture_menu_->addSeparator();
    make_action(capture_menu_, "connect", tr("Connect to..."), QKeySequence::Open,
                [this] { show_connect_dialog(); });
    make_action(capture_menu_, "screenshot", tr("Save screenshot..."), QKeySequence::Save,
                [this] { save_screenshot(); });
    make_action(capture_menu_, "plots", tr("Save plots..."), Qt::CTRL | Qt::Key_P, [this] { save_plots(); });
    make_action(capture_menu_, "quit", tr("Quit"), QKeySequence::Quit, [this] { close(); });
    bar->addActions({start_, learn, record_, save_buffer_, mark_action, calibrate});
    bar->addSeparator();
    const auto views = {std::tuple{"front", tr("Front"), Qt::Key_1, View::kFront},
                        {"side", tr("Side"), Qt::Key_2, View::kSide},
                        {"top", tr("Top"), Qt::Key_3, View::kTop},
                        {"oblique", tr("Oblique"), Qt::Key_4, View::kOblique}};
    for (const auto& [name, text, key, view] : views)
        bar->addAction(
            make_action(view_menu_, name, text, key, [this, view = view] { scene_->look_from(view); }));
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
    make_action(view, "next_subject", tr("Next athlete"), Qt::Key_A,
                [this] { change_subjects([](Subjects& subjects) { subjects.select_next(); }); });
    const auto toggle = [this](bool SceneItems::*which) {
        return [this, which](bool on) {
            scene_->items().*which = on;
            scene_->update();
        };
    };
    make_toggle(view, "volume", tr("Volume"), Qt::Key_V, true, toggle(&SceneItems::volume));
    make_toggle(view, "skeleton", tr("Skeleton"), Qt::Key_J, true, toggle(&SceneItems::skeleton));
    make_toggle(view, "frusta", tr("Cameras in the scene"), Qt::Key_C, true, toggle(&SceneItems::cameras));
    view->addSeparator();
    auto* kinds = new QActionGroup(this);
    const auto kind = [&](const char* name, const QString& text, const QKeySequence& key, PreviewKind which) {
        kinds->addAction(make_toggle(view, name, text, key, which == preview_kind_,
                                     [this, which](bool) { set_previews(which); }));
    };
    kind("images", tr("Camera images"), Qt::Key_P, PreviewKind::kImages);
    kind("silhouettes", tr("Silhouettes"), Qt::Key_O, PreviewKind::kSilhouettes);
    kind("no_images", tr("No images"), Qt::Key_N, PreviewKind::kNone);
    view->addSeparator();
    make_toggle(view, "light", tr("Light colours"), Qt::Key_L, !QSettings().value("dark", true).toBool(),
                [this](bool on) { set_dark(!on); });
    make_toggle(view, "fullscreen", tr("Full screen"), Qt::Key_F11, false,
                [this](bool on) { on ? showFullScreen() : showNormal(); });
}

void MainWindow::make_ghost_actions() {
    QMenu* menu = ghost_menu_;
    make_action(menu, "ghost", tr("Selected recording"), Qt::Key_G, [this] {
        const QListWidgetItem* item = recordings_->currentItem();
        if (!item) return show_message(tr("no recording selected; select one in the list"), false);
        ghost_->choose_recording(item->data(Qt::UserRole).toString().toStdString());
    });
    make_action(menu, "ghost_replayed", tr("Replayed recording, from its mark or the current frame"),
                Qt::SHIFT | Qt::Key_G, [this] { ghost_->choose_replayed(); });
    make_action(menu, "ghost_file", tr("From a file..."), Qt::CTRL | Qt::Key_G, [this] {
        const QString file =
            QFileDialog::getOpenFileName(this, tr("Table of joints"), {}, tr("Tables (*.csv)"));
        if (!file.isEmpty()) ghost_->choose_file(file);
    });
    make_action(menu, "no_ghost", tr("Close ghost"), {}, [this] { ghost_->clear(); });
    menu->addSeparator();
    make_action(menu, "ghost_later", tr("Ghost back"), Qt::Key_Comma, [this] { ghost_bar_->shift(-1); });
    make_action(menu, "ghost_earlier", tr("Ghost ahead"), Qt::Key_Period, [this] { ghost_bar_->shift(1); });
}

void MainWindow::make_replay_actions() {
    connect(replay_, &ReplayBar::play, this, [this](bool on) { report_busy_unless(commands_->play(on)); });
    connect(replay_, &ReplayBar::step, this,
            [this](int frames) { report_busy_unless(commands_->step(frames)); });
    connect(replay_, &ReplayBar::seek, this,
            [this](qint64 frame) { commands_->seek(frame); });  // a later position replaces it
    connect(replay_, &ReplayBar::speed, this,
            [this](double times) { report_busy_unless(commands_->set_speed(times)); });
    connect(replay_, &ReplayBar::loop, this,
            [this](bool on) { report_busy_unless(commands_->set_loop(on)); });
    connect(replay_, &ReplayBar::close_replay, this,
            [this] { report_busy_unless(commands_->close_replay()); });
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
           "<tr><td><b>click</b>&nbsp;&nbsp;</td><td>select one of several athletes</td></tr>"
           "<tr><td><b>drag, Shift + drag, wheel</b>&nbsp;&nbsp;</td><td>rotate, pan, zoom</td></tr>");
    QMessageBox::information(this, tr("Keys"), "<table>" + text + "</table>");
}

// Marks the current time in the curves and aligns the ghost's event with it.
void MainWindow::mark() {
    const auto now_ns = subjects_.history().latest_time_ns();
    if (!now_ns) return show_message(tr("no pose was measured yet; nothing to mark"), false);
    show_message(tr("mark %1").arg(marks_.add_mark(*now_ns)), true);
    ghost_->mark();
    angles_changed_ = true;
    show_panels_soon();
}

void MainWindow::show_connect_dialog() {
    ConnectDialog dialog(this);
    if (dialog.exec() == QDialog::Accepted) connect_to(dialog.connection());
}

void MainWindow::save_screenshot() {
    const QImage shot = screenshot();  // before the dialog opens
    const QString folder = QStandardPaths::writableLocation(QStandardPaths::PicturesLocation);
    const QString now = QDateTime::currentDateTime().toString("yyyy-MM-dd hh.mm.ss");
    const QString file = QFileDialog::getSaveFileName(this, tr("Save screenshot"),
                                                      folder + "/kinevox " + now + ".png", "PNG (*.png)");
    if (file.isEmpty()) return;
    const bool saved = shot.save(file);
    show_message(saved ? tr("saved as %1").arg(file) : tr("cannot write %1; choose another folder").arg(file),
                 saved);
}

void MainWindow::save_plots() {
    const QString folder = QFileDialog::getExistingDirectory(this, tr("Folder for the plots"));
    if (!folder.isEmpty()) save_plots_in(folder);
}

// Each curve as PNG for screens and as PDF for print.
void MainWindow::save_plots_in(const QString& folder) {
    for (int n = 0; n < AnglePanel::kCurves; ++n)
        for (const char* ending : {".png", ".pdf"}) {
            const std::string angle = angles_->choices()[static_cast<std::size_t>(AnglePanel::kNumbers + n)];
            const QString file = folder + "/" + QString::fromStdString(angle) + ending;
            if (!angles_->save_plot(n, file))
                return show_message(tr("cannot write %1; choose another folder").arg(file), false);
        }
    show_message(tr("saved in %1").arg(folder), true);
}

// A live source learns from the next frame sets; a recorded one from its background clip, with the capture
// stopped.
void MainWindow::learn_background() {
    const DaemonState state = feed_->state();
    const bool running = state.status && state.status->state() == v1::CAPTURE_STATE_RUNNING;
    if (running) show_message(tr("learning the background: leave the space empty for two seconds"), true);
    commands_->learn_background(running ? kBackgroundFrameSets : 0);
}

}  // namespace kinevox::viewer
