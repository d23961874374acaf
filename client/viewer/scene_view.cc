#include "client/viewer/scene_view.h"

#include <QFont>
#include <QFontMetrics>
#include <QMouseEvent>
#include <QOpenGLContext>
#include <QPainter>
#include <QSurfaceFormat>
#include <QWheelEvent>
#include <algorithm>
#include <array>
#include <chrono>
#include <vector>

#include "client/viewer/subjects.h"
#include "common/body_pose.h"
#include "common/median.h"

namespace kinevox::viewer {
namespace {

constexpr std::size_t kLatencies = 128;
constexpr int kUpdatePause_ms = 60;  // longer than between volumes
constexpr double kMaxLatency_ms = 10'000;
constexpr qint64 kRateWindow_ms = 10'000;
constexpr int kMaxClick_px = 4;  // a longer way of the pointer is a drag
constexpr float kLookAtHeight_m = 0.95f;
constexpr float kNameHeight_m = 0.08f;  // over the top of the head
constexpr int kNameWidth_px = 240;      // longer names are cut

std::int64_t utc_now_ns() {
    return std::chrono::duration_cast<std::chrono::nanoseconds>(
               std::chrono::system_clock::now().time_since_epoch())
        .count();
}

}  // namespace

SceneView::SceneView() {
    QSurfaceFormat format;
    format.setVersion(3, 3);
    format.setProfile(QSurfaceFormat::CoreProfile);
    format.setDepthBufferSize(24);
    format.setSwapInterval(1);
    setFormat(format);
    setFlag(Qt::WindowDoesNotAcceptFocus);  // the main window handles keys
    clock_.start();
    connect(this, &QOpenGLWindow::frameSwapped, this, &SceneView::swapped);
    due_.setSingleShot(true);
    connect(&due_, &QTimer::timeout, this, [this] { update(); });
}

SceneView::~SceneView() {
    if (context()) disconnect(context(), nullptr, this, nullptr);  // destroyed after the members
    close_painter();
}

void SceneView::close_painter() {
    if (!context()) return;
    makeCurrent();
    painter_.close();
    doneCurrent();
}

void SceneView::show_volume(std::shared_ptr<const ShownVolume> volume) {
    if (!volume) return;
    volume_ = volume;
    new_volume_ = std::move(volume);
    find_followed();
    update();
}

// The selected one; the only one may have another id by now than its pose.
void SceneView::find_followed() {
    subject_in_world_.reset();
    if (!volume_ || volume_->subjects.empty()) return;
    const ShownSubject* subject =
        subjects_.several ? volume_->subject(subjects_.selected) : &volume_->subjects.front();
    if (!subject) return;
    const Vec3& s = subject->centre_in_world;
    subject_in_world_ = QVector3D(static_cast<float>(s.x), static_cast<float>(s.y), kLookAtHeight_m);
}

void SceneView::show_subjects(const SceneSubjects& subjects) {
    if (subjects == subjects_) return;
    subjects_ = subjects;
    painter_.set_subjects(subjects);
    find_followed();
    update_soon();
}

void SceneView::show_poses(std::shared_ptr<const ShownPoses> poses) {
    poses_ = poses;
    new_poses_ = std::move(poses);
    update_soon();
}

void SceneView::show_ghost(std::shared_ptr<const ShownPose> pose) {
    new_ghost_ = std::move(pose);
    update_soon();
}

void SceneView::show_cameras(std::vector<Camera> cameras) {
    new_cameras_ = std::move(cameras);
    update();
}

void SceneView::show_previews(std::map<std::string, QImage> images) {
    new_previews_ = std::move(images);
    update_soon();
}

void SceneView::set_theme(const Theme& theme) {
    theme_ = theme;
    theme_changed_ = true;
    update();
}

void SceneView::update_soon() {
    if (!due_.isActive()) due_.start(kUpdatePause_ms);
}

void SceneView::look_from(View view) {
    eye_.look_from(view);
    update();
}

void SceneView::set_following(bool on) {
    following_ = on;
    update();
}

void SceneView::initializeGL() {
    connect(context(), &QOpenGLContext::aboutToBeDestroyed, this, &SceneView::close_painter);
    painter_.open();
}

void SceneView::paintGL() {
    due_.stop();
    if (std::exchange(theme_changed_, false)) painter_.set_theme(theme_);
    if (auto cameras = std::exchange(new_cameras_, std::nullopt)) painter_.set_cameras(*cameras);
    if (auto images = std::exchange(new_previews_, std::nullopt)) painter_.set_previews(*images);
    if (auto poses = std::exchange(new_poses_, nullptr)) painter_.set_poses(*poses);
    if (auto ghost = std::exchange(new_ghost_, nullptr)) painter_.set_ghost(*ghost);
    const qint64 now_ms = clock_.elapsed();
    if (auto volume = std::exchange(new_volume_, nullptr)) {
        painter_.set_volume(*volume);
        painted_capture_time_ns_ = volume->capture_time_ns;
        volume_paints_ms_.push_back(now_ms);
        while (now_ms - volume_paints_ms_.front() > kRateWindow_ms) volume_paints_ms_.pop_front();
    }
    if (following_ && subject_in_world_)
        eye_.follow(*subject_in_world_,
                    static_cast<float>(std::min<qint64>(now_ms - last_paint_ms_, 200)) / 1000.f);
    last_paint_ms_ = now_ms;
    ++paints_;
    const qreal scale = devicePixelRatio();
    painter_.paint(eye_, items_, static_cast<int>(width() * scale), static_cast<int>(height() * scale));
    paint_names();
}

// Over the heads of those who have one.
void SceneView::paint_names() {
    if (!poses_ || !items_.skeleton) return;
    const bool any = std::ranges::any_of(poses_->subjects,
                                         [](const ShownPose& pose) { return !pose.subject_name.empty(); });
    if (!any) return;
    const auto width_over_height = static_cast<float>(width()) / static_cast<float>(std::max(1, height()));
    const QMatrix4x4 clip_from_world = eye_.clip_from_eye(width_over_height) * eye_.eye_from_world();
    QPainter text(this);
    QFont font = text.font();
    font.setBold(true);
    text.setFont(font);
    for (const ShownPose& pose : poses_->subjects) {
        const auto& head = pose.joints_in_world[*joint_index("head_top")];
        if (pose.subject_name.empty() || !head) continue;
        const QVector4D at =
            clip_from_world * QVector4D(static_cast<float>(head->x), static_cast<float>(head->y),
                                        static_cast<float>(head->z) + kNameHeight_m, 1);
        if (at.w() <= 0) continue;
        const QPointF centre((0.5 + 0.5 * at.x() / at.w()) * width(),
                             (0.5 - 0.5 * at.y() / at.w()) * height());
        const QString name = text.fontMetrics().elidedText(QString::fromStdString(pose.subject_name),
                                                           Qt::ElideRight, kNameWidth_px);
        QRectF box = text.fontMetrics().boundingRect(name).adjusted(-4, -2, 4, 2);
        box.moveCenter(centre);
        QColor behind = theme_.background;
        behind.setAlpha(170);
        text.fillRect(box, behind);
        text.setPen(subjects_.several ? theme_.subject(subjects_.colour(pose.subject_id)) : theme_.text);
        text.drawText(box, Qt::AlignCenter, name);
    }
}

void SceneView::swapped() {
    const auto captured = std::exchange(painted_capture_time_ns_, std::nullopt);
    if (!captured) return;
    const double latency_ms = 1e-6 * static_cast<double>(utc_now_ns() - *captured);
    if (latency_ms < 0 || latency_ms > kMaxLatency_ms) return;
    latencies_ms_.push_back(latency_ms);
    if (latencies_ms_.size() > kLatencies) latencies_ms_.pop_front();
}

std::optional<double> SceneView::latency_ms() const {
    if (latencies_ms_.empty()) return {};
    std::vector<double> latencies_ms(latencies_ms_.begin(), latencies_ms_.end());
    return median_of(latencies_ms);
}

double SceneView::painted_volumes_per_second() const {
    const qint64 now_ms = clock_.elapsed();
    const auto count = std::count_if(volume_paints_ms_.begin(), volume_paints_ms_.end(),
                                     [&](qint64 t) { return now_ms - t < kRateWindow_ms; });
    return 1000.0 * static_cast<double>(count) /
           static_cast<double>(std::clamp<qint64>(now_ms, 1, kRateWindow_ms));
}

void SceneView::mousePressEvent(QMouseEvent* event) {
    grabbed_px_ = pressed_px_ = event->pos();
}

void SceneView::mouseReleaseEvent(QMouseEvent* event) {
    if (event->button() != Qt::LeftButton) return;
    if ((event->pos() - pressed_px_).manhattanLength() > kMaxClick_px) return;
    const ScenePoint at{1.0 * event->pos().x(), 1.0 * event->pos().y(), 1.0 * width(), 1.0 * height()};
    const auto width_over_height = static_cast<float>(width()) / static_cast<float>(std::max(1, height()));
    const QMatrix4x4 clip_from_world = eye_.clip_from_eye(width_over_height) * eye_.eye_from_world();
    std::array<double, 16> rows{};
    for (std::size_t n = 0; n < 16; ++n)
        rows[n] = clip_from_world(static_cast<int>(n / 4), static_cast<int>(n % 4));
    if (const auto id = subject_at(at, rows, items_.volume ? volume_.get() : nullptr,
                                   items_.skeleton ? poses_.get() : nullptr))
        emit subject_clicked(*id);
}

void SceneView::mouseMoveEvent(QMouseEvent* event) {
    const QPoint by = event->pos() - grabbed_px_;
    grabbed_px_ = event->pos();
    const auto right = static_cast<float>(by.x()), down = static_cast<float>(by.y());
    const bool pans =
        event->buttons() & (Qt::RightButton | Qt::MiddleButton) || event->modifiers() & Qt::ShiftModifier;
    if (pans) {
        eye_.pan(right, down, static_cast<float>(height()));
        following_ = false;
    } else if (event->buttons() & Qt::LeftButton) {
        eye_.orbit(right, down);
    }
    update();
}

void SceneView::mouseDoubleClickEvent(QMouseEvent*) {
    eye_ = OrbitCamera{};
    set_following(true);
}

void SceneView::wheelEvent(QWheelEvent* event) {
    eye_.zoom(static_cast<float>(event->angleDelta().y()) / 120.f);
    update();
}

}  // namespace kinevox::viewer
