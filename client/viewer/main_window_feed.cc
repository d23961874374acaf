// What comes from the daemon and where it goes in the window.
#include <QLabel>
#include <QListWidget>
#include <utility>

#include "client/viewer/angle_panel.h"
#include "client/viewer/calibration_panel.h"
#include "client/viewer/camera_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/connect_dialog.h"
#include "client/viewer/ghost.h"
#include "client/viewer/ghost_bar.h"
#include "client/viewer/main_window.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kPanels_ms = 100;
constexpr qint64 kAnswerShown_ms = 6000;

}  // namespace

void MainWindow::connect_to(const client::ConnectionOptions& connection) {
    const auto options = connection.open();
    if (!options.ok())
        return answered(QString::fromStdString(std::string(options.status().message())), false);
    ghost_.reset();
    calibration_.reset();
    commands_.reset();
    feed_.reset();
    history_.clear();
    marks_.clear();
    ghost_bar_->hide();
    scene_->show_volume(std::make_shared<ShownVolume>());
    scene_->show_pose(std::make_shared<ShownPose>());
    scene_->show_ghost(std::make_shared<ShownPose>());

    feed_ = std::make_unique<Feed>(*options);
    commands_ = std::make_unique<Commands>(*options);
    calibration_ = std::make_unique<Calibration>(*options);
    ghost_ = std::make_unique<Ghost>(*options, *ghost_bar_);
    connect_feed();
    connect_commands();
    calibration_panel_->set_calibration(calibration_.get());
    connect(ghost_.get(), &Ghost::changed, this, [this] { scene_->show_ghost(ghost_->pose()); });
    connect(ghost_.get(), &Ghost::answered, this, &MainWindow::answered);
    commands_->list_recordings();
    remember(connection);
}

void MainWindow::connect_feed() {
    connect(feed_.get(), &Feed::volume_came, this, &MainWindow::take_volume);
    connect(feed_.get(), &Feed::poses_came, this, &MainWindow::take_poses);
    connect(feed_.get(), &Feed::state_came, this, &MainWindow::take_state);
    connect(feed_.get(), &Feed::event_came, this, &MainWindow::take_event);
    connect(feed_.get(), &Feed::cameras_came, this, [this] {
        scene_->show_cameras(feed_->cameras());
        feed_->show_previews(PreviewKind::kNone);
        feed_->show_previews(preview_kind_);
    });
    connect(feed_.get(), &Feed::preview_came, this, [this] {
        previews_changed_ = true;
        show_panels_soon();
    });
    connect(feed_.get(), &Feed::previews_refused, this,
            [this](const QString& why) { answered(tr("No pictures: ") + why, true); });
}

void MainWindow::connect_commands() {
    connect(commands_.get(), &Commands::done, this,
            [this](const QString& message) { answered(message, true); });
    connect(commands_.get(), &Commands::failed, this,
            [this](const QString& message) { answered(message, false); });
    connect(commands_.get(), &Commands::recordings_came, this,
            [this](const QStringList& names, const QStringList& texts) {
                recordings_->clear();
                for (qsizetype n = 0; n < names.size(); ++n) {
                    auto* item = new QListWidgetItem(texts[n], recordings_);
                    item->setData(Qt::UserRole, names[n]);
                }
            });
}

void MainWindow::take_event(int kind, const QString& message, qint64 time_ns) {
    marks_.add_event(static_cast<v1::EventKind>(kind), time_ns);
    switch (kind) {
        case v1::EVENT_KIND_RECORDING_STOPPED:
            commands_->list_recordings();
            [[fallthrough]];
        case v1::EVENT_KIND_CAMERA_REJOINED:
            answered(message, true);
            break;
        case v1::EVENT_KIND_RECORDING_FAILED:
            commands_->list_recordings();
            [[fallthrough]];
        case v1::EVENT_KIND_RECORDING_DROPS:
        case v1::EVENT_KIND_CAMERA_LOST:
        case v1::EVENT_KIND_CAMERA_MOVED:
        case v1::EVENT_KIND_ERROR:
            answered(message, false);
            break;
        case v1::EVENT_KIND_CALIBRATION:
            if (calibration_panel_->isVisible()) calibration_->list();
            break;
        default:
            break;
    }
}

// Whatever is painted has the whole window put together anew, which costs more than the painting where there
// is no graphics card. So the panels are painted with a volume, and not every time: nobody reads faster.
void MainWindow::take_volume() {
    scene_->show_volume(feed_->volume());
    if (panels_due_.isActive() && panels_age_.elapsed() >= kPanels_ms) show_panels();
}

void MainWindow::show_panels_soon() {
    if (!panels_due_.isActive()) panels_due_.start(2 * kPanels_ms);
}

void MainWindow::show_panels() {
    panels_due_.stop();
    panels_age_.restart();
    if (std::exchange(angles_changed_, false)) angles_->show_history(history_, marks_);
    if (std::exchange(previews_changed_, false) && preview_kind_ != PreviewKind::kNone) {
        const auto pictures = feed_->previews();
        cameras_->show_previews(pictures);
        scene_->show_previews(pictures);
    }
}

void MainWindow::take_poses() {
    const auto poses = feed_->take_poses();
    if (poses.empty()) return;
    for (const auto& pose : poses) history_.add(*pose);
    scene_->show_pose(poses.back());
    const auto ghost = ghost_->pose_for(poses.back());
    if (ghost_->match().ghost()) scene_->show_ghost(ghost);
    angles_changed_ = true;
    show_panels_soon();
}

void MainWindow::take_state() {
    const DaemonState state = feed_->state();
    if (state.status) {
        cameras_->show_status(*state.status);
        running_ = state.status->state() == v1::CAPTURE_STATE_RUNNING ||
                   state.status->state() == v1::CAPTURE_STATE_LEARNING ||
                   state.status->state() == v1::CAPTURE_STATE_STARTING;
        start_->setText(running_ ? tr("Stop") : tr("Start"));
    }
    // What was asked before the last command was through would show the recording that it ended.
    const auto idle_since = commands_->idle_since();
    if (state.recorder && idle_since && state.asked_at >= *idle_since) {
        const v1::GetRecorderStatusResponse& r = *state.recorder;
        recording_ = r.has_recording();
        record_->setText(recording_ ? tr("Stop recording") : tr("Record"));
        const bool live = !replayed(state.replay.get());
        record_->setEnabled(live && r.state() != v1::RECORDER_STATE_OFF &&
                            r.state() != v1::RECORDER_STATE_FINISHING);
        keep_->setEnabled(live && r.held_seconds() > 0 && !recording_);
        keep_->setText(r.keep_last_seconds() > 0 ? tr("Keep last %1 s").arg(r.keep_last_seconds(), 0, 'g', 3)
                                                 : tr("Keep last"));
    }
    if (state.replay) replay_->show_replay(*state.replay);
    ghost_->show_state(state);
}

void MainWindow::show_words() {
    Link link = feed_->link();
    link.delay_ms = scene_->delay_ms();
    const DaemonState state = feed_->state();
    const Words words = in_words(link, state.status.get(), state.recorder.get(), state.replay.get());
    const QColor colour = words.mood == Mood::kGood   ? theme_.good
                          : words.mood == Mood::kCare ? theme_.care
                                                      : theme_.bad;
    state_label_->setText(QString::fromStdString(words.state));
    state_label_->setStyleSheet("color: " + colour.name());
    line_label_->setText(QString::fromStdString(words.line));
    const bool answer =
        !last_answer_.isEmpty() && answer_age_.isValid() && answer_age_.elapsed() < kAnswerShown_ms;
    remedy_label_->setText(answer ? last_answer_ : QString::fromStdString(words.remedy));
    remedy_label_->setStyleSheet("color: " + (answer ? theme_.text : colour).name());
}

QString MainWindow::status_line() const {
    return state_label_->text() + " | " + line_label_->text() + " | " + remedy_label_->text();
}

void MainWindow::answered(const QString& message, bool good) {
    if (message.isEmpty()) return;
    last_answer_ = good ? message : tr("Not done. ") + message;
    answer_age_.start();
    show_words();
}

void MainWindow::replay_recording(const QString& name) {
    busy_unless(commands_->open_replay(name.toStdString()));
}

v1::WatchProcedureResponse MainWindow::calibration_progress() const {
    return calibration_->progress();
}

void MainWindow::busy_unless(bool taken) {
    if (!taken) answered(tr("too much waits already; a moment"), false);
}

}  // namespace kinevox::viewer
