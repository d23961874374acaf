// Passes messages of the daemon to the panels.
#include <QLabel>
#include <QListWidget>
#include <utility>

#include "client/viewer/angle_panel.h"
#include "client/viewer/calibration_panel.h"
#include "client/viewer/camera_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/connect_dialog.h"
#include "client/viewer/ghost.h"
#include "client/viewer/main_window.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"
#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

constexpr int kPanels_ms = 100;
constexpr qint64 kMessageShown_ms = 6000;

}  // namespace

void MainWindow::connect_to(const client::ConnectionOptions& connection) {
    const auto options = connection.open();
    if (!options.ok())
        return show_message(QString::fromStdString(std::string(options.status().message())), false);
    ghost_.reset();
    calibration_.reset();
    commands_.reset();
    feed_.reset();
    subjects_.clear();
    latest_poses_.reset();
    marks_.clear();
    ghost_bar_->hide();
    scene_->show_volume(std::make_shared<ShownVolume>());
    scene_->show_poses(std::make_shared<ShownPoses>());
    scene_->show_subjects({});
    scene_->show_ghost(std::make_shared<ShownPose>());

    feed_ = std::make_unique<Feed>(*options);
    commands_ = std::make_unique<Commands>(*options);
    calibration_ = std::make_unique<Calibration>(*options);
    ghost_ = std::make_unique<Ghost>(*options, *ghost_bar_);
    connect_feed();
    connect_commands();
    calibration_panel_->set_calibration(calibration_.get());
    connect(ghost_.get(), &Ghost::changed, this, [this] { scene_->show_ghost(ghost_->pose()); });
    connect(ghost_.get(), &Ghost::reported, this, &MainWindow::show_message);
    commands_->list_recordings();
    store_connection(connection);
}

void MainWindow::connect_feed() {
    connect(feed_.get(), &Feed::volume_received, this, &MainWindow::take_volume);
    connect(feed_.get(), &Feed::poses_received, this, &MainWindow::take_poses);
    connect(feed_.get(), &Feed::state_received, this, &MainWindow::take_state);
    connect(feed_.get(), &Feed::event_received, this, &MainWindow::take_event);
    connect(feed_.get(), &Feed::cameras_received, this, [this] {
        scene_->show_cameras(feed_->cameras());
        feed_->show_previews(PreviewKind::kNone);
        feed_->show_previews(preview_kind_);
    });
    connect(feed_.get(), &Feed::preview_received, this, [this] {
        previews_changed_ = true;
        show_panels_soon();
    });
    connect(feed_.get(), &Feed::previews_denied, this,
            [this](const QString& why) { show_message(tr("No images: ") + why, true); });
}

void MainWindow::connect_commands() {
    connect(commands_.get(), &Commands::done, this,
            [this](const QString& message) { show_message(message, true); });
    connect(commands_.get(), &Commands::failed, this,
            [this](const QString& message) { show_message(message, false); });
    connect(commands_.get(), &Commands::recordings_received, this,
            [this](const QStringList& names, const QStringList& labels) {
                recordings_->clear();
                for (qsizetype n = 0; n < names.size(); ++n) {
                    auto* item = new QListWidgetItem(labels[n], recordings_);
                    item->setData(Qt::UserRole, names[n]);
                }
            });
}

void MainWindow::take_event(int kind, const QString& message, qint64 time_ns, quint32 subject_id) {
    marks_.add_event(static_cast<v1::EventKind>(kind), time_ns, subject_id);
    switch (kind) {
        case v1::EVENT_KIND_RECORDING_STOPPED:
            commands_->list_recordings();
            [[fallthrough]];
        case v1::EVENT_KIND_CAMERA_RECONNECTED:
        case v1::EVENT_KIND_SEGMENTATION_CHANGED:
            show_message(message, true);
            break;
        case v1::EVENT_KIND_RECORDING_FAILED:
            commands_->list_recordings();
            [[fallthrough]];
        case v1::EVENT_KIND_RECORDING_FRAMES_DROPPED:
        case v1::EVENT_KIND_CAMERA_DISCONNECTED:
        case v1::EVENT_KIND_CAMERA_MOVED:
        case v1::EVENT_KIND_CLOCK_STEPPED:
        case v1::EVENT_KIND_GPU_FAILED:
        case v1::EVENT_KIND_ERROR:
            show_message(message, false);
            break;
        case v1::EVENT_KIND_CALIBRATION_CHANGED:
            if (calibration_panel_->isVisible()) calibration_->list();
            break;
        default:
            break;
    }
}

// Every paint recomposes the whole window, which without a graphics card costs more than the painting itself.
// So the panels are painted together with a volume, at most ten times per second.
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
    if (std::exchange(angles_changed_, false)) angles_->show_history(subjects_, marks_);
    if (std::exchange(previews_changed_, false) && preview_kind_ != PreviewKind::kNone) {
        const auto images = feed_->previews();
        cameras_->show_previews(images);
        scene_->show_previews(images);
    }
}

void MainWindow::take_poses() {
    const auto poses = feed_->take_poses();
    if (poses.empty()) return;
    for (const auto& pose : poses) subjects_.add(*pose);
    latest_poses_ = poses.back();
    show_pose_of_selected();
}

void MainWindow::show_pose_of_selected() {
    scene_->show_subjects({subjects_.selected(), subjects_.several(), subjects_.colours()});
    if (latest_poses_) {
        scene_->show_poses(latest_poses_);
        const auto ghost =
            ghost_->pose_for(std::make_shared<const ShownPose>(latest_poses_->pose(subjects_.selected())));
        if (ghost_->match().ghost()) scene_->show_ghost(ghost);
    }
    angles_changed_ = true;
    show_panels_soon();
}

void MainWindow::change_subjects(const std::function<void(Subjects&)>& change) {
    change(subjects_);
    show_pose_of_selected();
}

void MainWindow::take_state() {
    const DaemonState state = feed_->state();
    if (state.status) {
        cameras_->show_status(*state.status);
        running_ = state.status->state() == v1::CAPTURE_STATE_RUNNING ||
                   state.status->state() == v1::CAPTURE_STATE_LEARNING_BACKGROUND ||
                   state.status->state() == v1::CAPTURE_STATE_STARTING;
        start_->setText(running_ ? tr("Stop") : tr("Start"));
    }
    // A state requested before the latest command finished would still show the recording that it ended.
    const auto idle_since = commands_->idle_since();
    if (state.recorder && idle_since && state.requested_at >= *idle_since) {
        const v1::GetRecorderStatusResponse& r = *state.recorder;
        recording_ = r.has_current();
        record_->setText(recording_ ? tr("Stop recording") : tr("Record"));
        const bool live = !replayed(state.replay.get());
        record_->setEnabled(live && r.state() != v1::RECORDER_STATE_DISABLED &&
                            r.state() != v1::RECORDER_STATE_FINISHING);
        save_buffer_->setEnabled(live && to_seconds(r.buffered_duration()) > 0 && !recording_);
        const double buffer_s = to_seconds(r.max_buffer_duration());
        save_buffer_->setText(buffer_s > 0 ? tr("Save last %1 s").arg(buffer_s, 0, 'g', 3)
                                           : tr("Save buffer"));
    }
    if (state.replay) replay_->show_replay(*state.replay);
    ghost_->show_state(state);
}

void MainWindow::show_status() {
    ConnectionStatus connection = feed_->connection();
    connection.latency_ms = scene_->latency_ms();
    const DaemonState state = feed_->state();
    const StatusText text =
        describe_status(connection, state.status.get(), state.recorder.get(), state.replay.get());
    const QColor colour = text.severity == Severity::kOk        ? theme_.good
                          : text.severity == Severity::kWarning ? theme_.warning
                                                                : theme_.error;
    state_label_->setText(QString::fromStdString(text.state));
    state_label_->setStyleSheet("color: " + colour.name());
    line_label_->setText(QString::fromStdString(text.line));
    const bool show_latest = connection.connected && !latest_message_.isEmpty() && message_age_.isValid() &&
                             message_age_.elapsed() < kMessageShown_ms;
    remedy_label_->setText(show_latest ? latest_message_ : QString::fromStdString(text.remedy));
    remedy_label_->setStyleSheet("color: " + (show_latest ? theme_.text : colour).name());
}

QString MainWindow::status_line() const {
    return state_label_->text() + " | " + line_label_->text() + " | " + remedy_label_->text();
}

void MainWindow::show_message(const QString& message, bool ok) {
    if (message.isEmpty()) return;
    latest_message_ = ok ? message : tr("Failed: ") + message;
    message_age_.start();
    show_status();
}

void MainWindow::replay_recording(const QString& name) {
    report_busy_unless(commands_->open_replay(name.toStdString()));
}

v1::WatchProcedureResponse MainWindow::calibration_progress() const {
    return calibration_->progress();
}

void MainWindow::report_busy_unless(bool accepted) {
    if (!accepted) show_message(tr("too many pending commands; try again"), false);
}

}  // namespace kinevox::viewer
