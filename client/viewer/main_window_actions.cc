// What the coach can press: toolbar, menus and keys.
#include <QAction>
#include <QActionGroup>
#include <QDateTime>
#include <QFileDialog>
#include <QInputDialog>
#include <QMenuBar>
#include <QMessageBox>
#include <QStandardPaths>
#include <QToolBar>

#include "client/viewer/angle_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/main_window.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kBackgroundFrames = 60;

}  // namespace

void MainWindow::make_actions() {
    auto* bar = addToolBar(tr("Capture"));
    bar->setObjectName("capture");
    QMenu* capture = menuBar()->addMenu(tr("&Capture"));
    QMenu* view = menuBar()->addMenu(tr("&View"));
    QMenu* help = menuBar()->addMenu(tr("&Help"));
    const auto action = [this](QMenu* menu, const char* name, const QString& text, const QKeySequence& key, auto act) {
        QAction* made = menu->addAction(text);
        made->setObjectName(name);
        made->setShortcut(key);
        made->setToolTip(key.isEmpty() ? text : text + " (" + key.toString(QKeySequence::NativeText) + ")");
        connect(made, &QAction::triggered, this, act);
        return made;
    };
    const auto busy = [this](bool taken) {
        if (!taken) answered(tr("too much waits already; a moment"), false);
    };

    start_ = action(capture, "start", tr("Start"), Qt::Key_S,
                    [this, busy] { busy(running_ ? commands_->stop_capture() : commands_->start_capture()); });
    QAction* learn = action(capture, "learn", tr("Learn the empty scene"), Qt::Key_B, [this] { learn_background(); });
    record_ = action(capture, "record", tr("Record"), Qt::Key_R,
                     [this, busy] { busy(recording_ ? commands_->stop_recording() : commands_->start_recording()); });
    keep_ = action(capture, "keep", tr("Keep last"), Qt::Key_K, [this, busy] { busy(commands_->keep_last()); });
    capture->addSeparator();
    action(capture, "connect", tr("Connect to..."), QKeySequence::Open, [this] { ask_for_server(); });
    action(capture, "screenshot", tr("Save a picture..."), QKeySequence::Save, [this] { save_screenshot(); });
    action(capture, "plots", tr("Save the plots..."), Qt::CTRL | Qt::Key_P, [this] { save_plots(); });
    action(capture, "quit", tr("Quit"), QKeySequence::Quit, [this] { close(); });
    bar->addActions({start_, learn, record_, keep_});
    bar->addSeparator();

    const auto looks = {std::tuple{"front", tr("Front"), Qt::Key_1, Look::kFront}, {"side", tr("Side"), Qt::Key_2, Look::kSide},
                        {"top", tr("Top"), Qt::Key_3, Look::kTop}, {"oblique", tr("Oblique"), Qt::Key_4, Look::kOblique}};
    for (const auto& [name, text, key, from] : looks)
        bar->addAction(action(view, name, text, key, [this, from] { scene_->look(from); }));
    view->addSeparator();
    const auto toggle = [&](const char* name, const QString& text, const QKeySequence& key, bool on, auto act) {
        QAction* made = action(view, name, text, key, act);
        made->setCheckable(true);
        made->setChecked(on);
        return made;
    };
    toggle("follow", tr("Follow the athlete"), Qt::Key_F, true, [this](bool on) { scene_->set_following(on); });
    const auto part = [this](bool SceneParts::*which) {
        return [this, which](bool on) {
            scene_->parts().*which = on;
            scene_->update();
        };
    };
    toggle("volume", tr("Volume"), Qt::Key_V, true, part(&SceneParts::volume));
    toggle("skeleton", tr("Skeleton"), Qt::Key_J, true, part(&SceneParts::skeleton));
    toggle("frusta", tr("Cameras in the scene"), Qt::Key_C, true, part(&SceneParts::cameras));
    view->addSeparator();
    auto* kinds = new QActionGroup(this);
    const auto kind = [&](const char* name, const QString& text, const QKeySequence& key, PreviewKind which) {
        kinds->addAction(toggle(name, text, key, which == preview_kind_, [this, which] { set_previews(which); }));
    };
    kind("pictures", tr("Cameras' pictures"), Qt::Key_P, PreviewKind::kPictures);
    kind("silhouettes", tr("Silhouettes"), Qt::Key_O, PreviewKind::kSilhouettes);
    kind("no_pictures", tr("No pictures"), Qt::Key_N, PreviewKind::kNone);
    view->addSeparator();
    toggle("light", tr("Light colours"), Qt::Key_L, false, [this](bool on) { set_dark(!on); });
    toggle("fullscreen", tr("Full screen"), Qt::Key_F11, false, [this](bool on) { on ? showFullScreen() : showNormal(); });
    action(help, "keys", tr("Keys"), QKeySequence::HelpContents, [this, capture, view] {
        QString text;
        for (const QMenu* menu : {capture, view})
            for (const QAction* a : menu->actions())
                if (!a->shortcut().isEmpty())
                    text += QString("<tr><td><b>%1</b>&nbsp;&nbsp;</td><td>%2</td></tr>")
                                .arg(a->shortcut().toString(QKeySequence::NativeText), a->text());
        text += tr("<tr><td><b>Space, Left, Right</b>&nbsp;&nbsp;</td><td>play or pause, step in a replay</td></tr>"
                   "<tr><td><b>drag, Shift + drag, wheel</b>&nbsp;&nbsp;</td><td>turn, move, near</td></tr>");
        QMessageBox::information(this, tr("Keys"), "<table>" + text + "</table>");
    });

    connect(replay_, &ReplayBar::play, this, [this, busy](bool on) { busy(commands_->play(on)); });
    connect(replay_, &ReplayBar::step, this, [this, busy](int frames) { busy(commands_->step(frames)); });
    connect(replay_, &ReplayBar::seek, this, [this](qint64 frame) { commands_->seek(frame); });   // the next one counts
    connect(replay_, &ReplayBar::speed, this, [this, busy](double times) { busy(commands_->set_speed(times)); });
    connect(replay_, &ReplayBar::loop, this, [this, busy](bool on) { busy(commands_->set_loop(on)); });
    connect(replay_, &ReplayBar::close_replay, this, [this, busy] { busy(commands_->close_replay()); });
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

void MainWindow::ask_for_server() {
    bool given = false;
    const QString server =
        QInputDialog::getItem(this, tr("Connect to"), tr("The daemon's HOST:PORT"), recent_servers(), 0, true, &given);
    if (given && !server.trimmed().isEmpty()) connect_to(server.trimmed());
}

void MainWindow::save_screenshot() {
    const QImage shot = picture();   // of now, not of when the dialogue is closed
    const QString folder = QStandardPaths::writableLocation(QStandardPaths::PicturesLocation);
    const QString now = QDateTime::currentDateTime().toString("yyyy-MM-dd hh.mm.ss");
    const QString file =
        QFileDialog::getSaveFileName(this, tr("Save a picture"), folder + "/kinevox " + now + ".png", "PNG (*.png)");
    if (file.isEmpty()) return;
    const bool saved = shot.save(file);
    answered(saved ? tr("saved as %1").arg(file) : tr("%1 cannot be written; choose another folder").arg(file), saved);
}

void MainWindow::save_plots() {
    const QString folder = QFileDialog::getExistingDirectory(this, tr("Where the plots go"));
    if (folder.isEmpty()) return;
    for (int n = 0; n < AnglePanel::kCurves; ++n) {
        const std::string angle = angles_->choices()[static_cast<std::size_t>(AnglePanel::kNumbers + n)];
        const QString file = folder + "/" + QString::fromStdString(angle) + ".pdf";
        if (!angles_->save_plot(n, file)) return answered(tr("%1 cannot be written; choose another folder").arg(file), false);
    }
    answered(tr("saved in %1").arg(folder), true);
}

// A live scene is learned from what comes next; a recorded one has its own clip, for which the capture has to stand still.
void MainWindow::learn_background() {
    const DaemonState state = feed_->state();
    const bool running = state.status && state.status->state() == v1::CAPTURE_STATE_RUNNING;
    if (running) answered(tr("learning: leave the space empty for two seconds"), true);
    commands_->learn_background(running ? kBackgroundFrames : 0);
}

}  // namespace kinevox::viewer
