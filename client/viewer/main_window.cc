#include "client/viewer/main_window.h"

#include <QApplication>
#include <QCloseEvent>
#include <QDockWidget>
#include <QLabel>
#include <QListWidget>
#include <QPainter>
#include <QScreen>
#include <QSettings>
#include <QStatusBar>
#include <QStyle>
#include <algorithm>
#include <utility>

#include "client/viewer/angle_panel.h"
#include "client/viewer/calibration_panel.h"
#include "client/viewer/camera_panel.h"
#include "client/viewer/commands.h"
#include "client/viewer/ghost.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/scene_view.h"

namespace kinevox::viewer {
namespace {

constexpr int kStatusInterval_ms = 250;

}  // namespace

MainWindow::MainWindow(const client::ConnectionOptions& connection) {
    setWindowTitle("Kinevox");
    // Default size: most of the screen, from laptop to 4K. The latest geometry is restored below.
    const QSize available = screen()->availableSize();
    resize(QSize(std::max(1280, 3 * available.width() / 4), std::max(800, 3 * available.height() / 4))
               .boundedTo(available));
    scene_ = new SceneView;
    scene_widget_ = QWidget::createWindowContainer(scene_, this);  // owns it
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
    ghost_bar_->hide();

    // Updates panels when no volumes arrive, as while the capture is stopped.
    connect(&panels_due_, &QTimer::timeout, this, &MainWindow::show_panels);
    panels_due_.setSingleShot(true);
    panels_age_.start();
    connect(&status_due_, &QTimer::timeout, this, &MainWindow::show_status);
    status_due_.start(kStatusInterval_ms);
    connect_to(connection);
}

MainWindow::~MainWindow() {
    ghost_.reset();
    calibration_.reset();
    commands_.reset();
    feed_.reset();
}

void MainWindow::make_docks() {
    const auto dock = [this](const QString& title, const char* name, QWidget* widget,
                             Qt::DockWidgetArea where) {
        auto* made = new QDockWidget(title, this);
        made->setObjectName(name);
        made->setWidget(widget);
        addDockWidget(where, made);
        return made;
    };
    angles_ = new AnglePanel(this);
    dock(tr("Angles"), "angles", angles_, Qt::RightDockWidgetArea);
    const auto select = [this](quint32 id) {
        change_subjects([id](Subjects& subjects) { subjects.select(id); });
    };
    connect(angles_, &AnglePanel::subject_selected, this, select);
    connect(angles_, &AnglePanel::subject_compared, this,
            [this](quint32 id) { change_subjects([id](Subjects& subjects) { subjects.compare(id); }); });
    connect(scene_, &SceneView::subject_clicked, this, select);
    cameras_ = new CameraPanel(this);
    QDockWidget* cameras = dock(tr("Cameras"), "cameras", cameras_, Qt::BottomDockWidgetArea);
    recordings_ = new QListWidget(this);
    recordings_->setObjectName("recordings");
    QDockWidget* recordings = dock(tr("Recordings"), "recordings", recordings_, Qt::BottomDockWidgetArea);
    splitDockWidget(cameras, recordings, Qt::Horizontal);
    resizeDocks({cameras, recordings}, {700, 240}, Qt::Horizontal);
    resizeDocks({cameras}, {170}, Qt::Vertical);
    connect(recordings_, &QListWidget::itemActivated, this,
            [this](const QListWidgetItem* item) { replay_recording(item->data(Qt::UserRole).toString()); });
    calibration_panel_ = new CalibrationPanel(this);
    calibration_dock_ = dock(tr("Calibration"), "calibration", calibration_panel_, Qt::LeftDockWidgetArea);
    calibration_dock_->hide();
    connect(calibration_panel_, &CalibrationPanel::reported, this, &MainWindow::show_message);
    replay_ = new ReplayBar(this);
    addToolBar(Qt::BottomToolBarArea, replay_);
    addToolBarBreak(Qt::BottomToolBarArea);
    ghost_bar_ = new GhostBar(this);
    addToolBar(Qt::BottomToolBarArea, ghost_bar_);
}

void MainWindow::set_dark(bool dark) {
    theme_ = Theme::make(dark);
    theme_.apply_to(*qApp);
    scene_->set_theme(theme_);
    angles_->set_theme(theme_);
    cameras_->set_theme(theme_);
    calibration_panel_->set_theme(theme_);
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

QImage MainWindow::screenshot() {
    QImage image(size() * devicePixelRatio(), QImage::Format_RGB32);  // at the screen's resolution
    image.setDevicePixelRatio(devicePixelRatio());
    render(&image);
    // render() does not include OpenGL content.
    QPainter painter(&image);
    painter.drawImage(QRect(scene_widget_->mapTo(this, QPoint(0, 0)), scene_widget_->size()),
                      scene_->grabFramebuffer());
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
