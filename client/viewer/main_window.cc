#include "client/viewer/main_window.h"

#include <QApplication>
#include <QCloseEvent>
#include <QDockWidget>
#include <QLabel>
#include <QListWidget>
#include <QPainter>
#include <QSettings>
#include <QStatusBar>
#include <QStyle>

#include <utility>

#include "client/viewer/angle_panel.h"
#include "client/viewer/camera_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kPanels_ms = 100, kWords_ms = 250, kMostRecent = 8;
constexpr qint64 kAnswerShown_ms = 6000;

}  // namespace

MainWindow::MainWindow(const QString& server) {
    setWindowTitle("Kinevox");
    resize(1280, 800);
    scene_ = new SceneView;
    scene_widget_ = QWidget::createWindowContainer(scene_, this);   // owns it
    scene_widget_->setMinimumSize(320, 240);
    setCentralWidget(scene_widget_);
    make_docks();
    make_actions();
    state_label_ = new QLabel(this);
    line_label_ = new QLabel(this);
    remedy_label_ = new QLabel(this);
    QFont bold = state_label_->font();
    bold.setBold(true);
    state_label_->setFont(bold);
    statusBar()->addWidget(state_label_);
    statusBar()->addWidget(line_label_);
    statusBar()->addWidget(remedy_label_, 1);

    const QSettings settings;
    restoreGeometry(settings.value("geometry").toByteArray());
    restoreState(settings.value("layout").toByteArray());
    std::vector<std::string> chosen;
    for (const QString& name : settings.value("angles").toStringList()) chosen.push_back(name.toStdString());
    angles_->choose(chosen);
    set_dark(settings.value("dark", true).toBool());
    replay_->hide();

    // Without volumes, as while the capture stands still.
    connect(&panels_due_, &QTimer::timeout, this, &MainWindow::show_panels);
    panels_due_.setSingleShot(true);
    panels_age_.start();
    connect(&words_due_, &QTimer::timeout, this, &MainWindow::show_words);
    words_due_.start(kWords_ms);
    connect_to(server);
}

MainWindow::~MainWindow() {
    commands_.reset();
    feed_.reset();
}

void MainWindow::make_docks() {
    const auto dock = [this](const QString& title, const char* name, QWidget* widget, Qt::DockWidgetArea where) {
        auto* made = new QDockWidget(title, this);
        made->setObjectName(name);
        made->setWidget(widget);
        addDockWidget(where, made);
        return made;
    };
    angles_ = new AnglePanel(this);
    dock(tr("Angles"), "angles", angles_, Qt::RightDockWidgetArea);
    cameras_ = new CameraPanel(this);
    QDockWidget* cameras = dock(tr("Cameras"), "cameras", cameras_, Qt::BottomDockWidgetArea);
    recordings_ = new QListWidget(this);
    QDockWidget* recordings = dock(tr("Recordings"), "recordings", recordings_, Qt::BottomDockWidgetArea);
    splitDockWidget(cameras, recordings, Qt::Horizontal);
    resizeDocks({cameras, recordings}, {700, 240}, Qt::Horizontal);
    resizeDocks({cameras}, {170}, Qt::Vertical);
    connect(recordings_, &QListWidget::itemActivated, this,
            [this](const QListWidgetItem* item) { replay_recording(item->data(Qt::UserRole).toString()); });
    replay_ = new ReplayBar(this);
    addToolBar(Qt::BottomToolBarArea, replay_);
}

void MainWindow::connect_to(const QString& server) {
    commands_.reset();
    feed_.reset();
    history_.clear();
    scene_->show_volume(std::make_shared<ShownVolume>());
    scene_->show_pose(std::make_shared<ShownPose>());

    const std::string address = server.toStdString();
    feed_ = std::make_unique<Feed>(address);
    commands_ = std::make_unique<Commands>(address);
    connect(feed_.get(), &Feed::volume_came, this, &MainWindow::take_volume);
    connect(feed_.get(), &Feed::poses_came, this, &MainWindow::take_poses);
    connect(feed_.get(), &Feed::state_came, this, &MainWindow::take_state);
    connect(feed_.get(), &Feed::cameras_came, this, [this] {
        scene_->show_cameras(feed_->cameras());
        feed_->show_previews(PreviewKind::kNone);
        feed_->show_previews(preview_kind_);
    });
    connect(feed_.get(), &Feed::preview_came, this, [this] {
        previews_changed_ = true;
        show_panels_soon();
    });
    connect(feed_.get(), &Feed::event_came, this, [this](int kind, const QString& message) {
        switch (kind) {
            case v1::EVENT_KIND_RECORDING_STOPPED: commands_->list_recordings(); [[fallthrough]];
            case v1::EVENT_KIND_CAMERA_REJOINED: answered(message, true); break;
            case v1::EVENT_KIND_RECORDING_FAILED: commands_->list_recordings(); [[fallthrough]];
            case v1::EVENT_KIND_RECORDING_DROPS:
            case v1::EVENT_KIND_CAMERA_LOST:
            case v1::EVENT_KIND_CAMERA_MOVED:
            case v1::EVENT_KIND_ERROR: answered(message, false); break;
            default: break;
        }
    });
    connect(commands_.get(), &Commands::done, this, [this](const QString& message) { answered(message, true); });
    connect(commands_.get(), &Commands::failed, this, [this](const QString& message) { answered(message, false); });
    connect(commands_.get(), &Commands::recordings_came, this, [this](const QStringList& names, const QStringList& texts) {
        recordings_->clear();
        for (qsizetype n = 0; n < names.size(); ++n) {
            auto* item = new QListWidgetItem(texts[n], recordings_);
            item->setData(Qt::UserRole, names[n]);
        }
    });
    commands_->list_recordings();

    QSettings settings;
    QStringList recent = recent_servers();
    recent.removeAll(server);
    recent.prepend(server);
    settings.setValue("servers", QStringList(recent.mid(0, kMostRecent)));
}

QStringList MainWindow::recent_servers() { return QSettings().value("servers").toStringList(); }

// Whatever is painted has the whole window put together anew, which costs more than the painting where there is no
// graphics card. So the panels are painted with a volume, and not every time: nobody reads faster.
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
    if (std::exchange(angles_changed_, false)) angles_->show_history(history_);
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
    angles_changed_ = true;
    show_panels_soon();
}

void MainWindow::take_state() {
    const DaemonState state = feed_->state();
    if (state.status) {
        cameras_->show_status(*state.status);
        running_ = state.status->state() == v1::CAPTURE_STATE_RUNNING || state.status->state() == v1::CAPTURE_STATE_LEARNING ||
                   state.status->state() == v1::CAPTURE_STATE_STARTING;
        start_->setText(running_ ? tr("Stop") : tr("Start"));
    }
    if (state.recorder) {
        const v1::GetRecorderStatusResponse& r = *state.recorder;
        recording_ = r.has_recording();
        record_->setText(recording_ ? tr("Stop recording") : tr("Record"));
        const bool live = !state.replay || state.replay->state() == v1::REPLAY_STATE_LIVE;
        record_->setEnabled(live && r.state() != v1::RECORDER_STATE_OFF && r.state() != v1::RECORDER_STATE_FINISHING);
        keep_->setEnabled(live && r.held_seconds() > 0 && !recording_);
        keep_->setText(r.keep_last_seconds() > 0 ? tr("Keep last %1 s").arg(r.keep_last_seconds(), 0, 'g', 3)
                                                 : tr("Keep last"));
    }
    if (state.replay) replay_->show_replay(*state.replay);
}

void MainWindow::show_words() {
    Link link = feed_->link();
    link.delay_ms = scene_->delay_ms();
    link.painted_per_second = scene_->painted_volumes_per_second();
    const DaemonState state = feed_->state();
    const Words words = in_words(link, state.status.get(), state.recorder.get(), state.replay.get());
    const QColor colour = words.mood == Mood::kGood ? theme_.good : words.mood == Mood::kCare ? theme_.care : theme_.bad;
    state_label_->setText(QString::fromStdString(words.state));
    state_label_->setStyleSheet("color: " + colour.name());
    line_label_->setText(QString::fromStdString(words.line));
    const bool answer = !last_answer_.isEmpty() && answer_age_.isValid() && answer_age_.elapsed() < kAnswerShown_ms;
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

void MainWindow::set_dark(bool dark) {
    theme_ = Theme::make(dark);
    theme_.apply_to(*qApp);
    scene_->set_theme(theme_);
    angles_->set_theme(theme_);
    cameras_->set_theme(theme_);
    QSettings().setValue("dark", dark);
}

void MainWindow::set_previews(PreviewKind kind) {
    preview_kind_ = kind;
    feed_->show_previews(kind);
    if (kind == PreviewKind::kNone) {
        cameras_->show_previews({});
        scene_->show_previews({});
    }
}

void MainWindow::replay_recording(const QString& name) {
    if (!commands_->open_replay(name.toStdString())) answered(tr("too much waits already; a moment"), false);
}

QImage MainWindow::picture() {
    QImage image(size(), QImage::Format_RGB32);
    render(&image);
    // What OpenGL painted is not in what render() draws.
    QPainter painter(&image);
    painter.drawImage(QRect(scene_widget_->mapTo(this, QPoint(0, 0)), scene_widget_->size()), scene_->grabFramebuffer());
    return image;
}

void MainWindow::closeEvent(QCloseEvent* event) {
    QSettings settings;
    settings.setValue("geometry", saveGeometry());
    settings.setValue("layout", saveState());
    QStringList chosen;
    for (const std::string& name : angles_->choices()) chosen.push_back(QString::fromStdString(name));
    settings.setValue("angles", chosen);
    event->accept();
}

}  // namespace kinevox::viewer
