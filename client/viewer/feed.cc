#include "client/viewer/feed.h"

#include <algorithm>
#include <utility>

#include "common/body_pose.h"
#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

constexpr double kMaxVolumes_hz = 30, kPreviews_hz = 5;
constexpr int kPreviewWidth_px = 320;
constexpr std::size_t kMaxPoses = 512;
constexpr std::chrono::milliseconds kStatePause{250}, kRetryPause{500};

ShownPose shown(const v1::SubjectPose& subject, const ShownPoses& poses) {
    ShownPose pose = poses.pose(subject.subject_id());
    pose.subject_name = subject.name();
    pose.found = subject.has_pose();
    for (const v1::JointEstimate& joint : subject.pose().joints())
        if (const auto index = joint_index(joint.name()); index && joint.has_position_in_world()) {
            const v1::Vec3& p = joint.position_in_world();
            pose.joints_in_world[*index] = Vec3{p.x(), p.y(), p.z()};
        }
    for (const v1::AngleEstimate& angle : subject.pose().angles())
        pose.angles.push_back(
            {angle.name(), angle.has_value_deg() ? std::optional(angle.value_deg()) : std::nullopt});
    return pose;
}

ShownPoses shown(const v1::StreamPosesResponse& message) {
    ShownPoses poses;
    poses.sequence = message.header().sequence();
    poses.capture_time_ns = message.header().capture_time_ns();
    if (message.header().has_recorded_frame()) poses.recorded_frame = message.header().recorded_frame();
    for (const v1::SubjectPose& subject : message.subjects()) poses.subjects.push_back(shown(subject, poses));
    return poses;
}

ShownVolume shown(const client::VolumeFrame& frame) {
    ShownVolume volume;
    volume.sequence = frame.header.sequence();
    volume.capture_time_ns = frame.header.capture_time_ns();
    if (frame.header.has_recorded_frame()) volume.recorded_frame = frame.header.recorded_frame();
    for (const client::SubjectVolume& subject : frame.subjects) {
        volume.volume_litres += subject.volume_litres;
        const v1::Vec3& c = subject.subject.centre_in_world();
        ShownSubject shown{subject.subject.subject_id(), volume.points.size(), 0, {c.x(), c.y(), c.z()}};
        if (subject.volume) {
            const std::vector<SurfacePoint> points = surface_points(*subject.volume);
            shown.point_count = points.size();
            volume.points.insert(volume.points.end(), points.begin(), points.end());
            volume.voxel_m = subject.volume->grid.voxel_m;
        }
        volume.subjects.push_back(shown);
    }
    return volume;
}

}  // namespace

Feed::Feed(client::ClientOptions options) : options_(std::move(options)) {
    threads_.emplace_back([this](const std::stop_token& stop) { run_states(stop); });
    threads_.emplace_back([this](const std::stop_token& stop) { run_volumes(stop); });
    threads_.emplace_back([this](const std::stop_token& stop) { run_poses(stop); });
    threads_.emplace_back([this](const std::stop_token& stop) { run_events(stop); });
}

Feed::~Feed() {
    for (std::jthread& thread : threads_) thread.request_stop();
    for (std::jthread& thread : preview_threads_) thread.request_stop();
}

std::shared_ptr<const ShownVolume> Feed::volume() const {
    const std::scoped_lock lock(mutex_);
    return volume_;
}

std::vector<std::shared_ptr<const ShownPoses>> Feed::take_poses() {
    const std::scoped_lock lock(mutex_);
    return std::exchange(poses_, {});
}

DaemonState Feed::state() const {
    const std::scoped_lock lock(mutex_);
    return state_;
}

std::vector<Camera> Feed::cameras() const {
    const std::scoped_lock lock(mutex_);
    return cameras_;
}

std::map<std::string, QImage> Feed::previews() const {
    const std::scoped_lock lock(mutex_);
    return previews_;
}

ConnectionStatus Feed::connection() const {
    const std::scoped_lock lock(mutex_);
    ConnectionStatus status;
    status.server = options_.server;
    status.connected = connected_;
    status.error_message = error_message_;
    status.idle_s = since_message_.seconds();
    return status;
}

void Feed::show_previews(PreviewKind kind) {
    std::vector<Camera> cameras;
    {
        const std::scoped_lock lock(mutex_);
        if (kind == preview_kind_ &&
            (kind == PreviewKind::kNone || preview_threads_.size() == cameras_.size()))
            return;
        preview_kind_ = kind;
        cameras = cameras_;
    }
    for (std::jthread& thread : preview_threads_) thread.request_stop();
    preview_threads_.clear();
    {
        const std::scoped_lock lock(mutex_);
        previews_.clear();
    }
    if (kind == PreviewKind::kNone) return;
    for (const Camera& camera : cameras)
        preview_threads_.emplace_back(
            [this, kind, name = camera.name](const std::stop_token& stop) { run_preview(name, kind, stop); });
}

void Feed::mark_alive() {
    since_message_ = {};
    connected_ = true;
    error_message_.clear();
}

// Restarts a stream after a pause when the daemon has ended or rejected it.
void Feed::run_until_stopped(const std::stop_token& stop, const std::function<absl::Status()>& stream) {
    while (!stop.stop_requested()) {
        stream().IgnoreError();
        std::unique_lock lock(mutex_);
        wake_.wait_for(lock, stop, kRetryPause, [] { return false; });
    }
}

void Feed::run_volumes(const std::stop_token& stop) {
    client::Client client(options_);
    v1::StreamVolumesRequest request;
    request.set_max_rate_hz(kMaxVolumes_hz);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    run_until_stopped(stop, [&] {
        return client.stream_volumes(
            request,
            [this](const client::VolumeFrame& frame) {
                auto volume = std::make_shared<const ShownVolume>(shown(frame));
                {
                    const std::scoped_lock lock(mutex_);
                    volume_ = std::move(volume);
                    mark_alive();
                }
                emit volume_received();
                return true;
            },
            options);
    });
}

void Feed::run_poses(const std::stop_token& stop) {
    client::Client client(options_);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    run_until_stopped(stop, [&] {
        return client.stream_poses(
            {},
            [this](const v1::StreamPosesResponse& message) {
                auto poses = std::make_shared<const ShownPoses>(shown(message));
                {
                    const std::scoped_lock lock(mutex_);
                    if (poses_.size() >= kMaxPoses) poses_.erase(poses_.begin());
                    poses_.push_back(std::move(poses));
                    mark_alive();
                }
                emit poses_received();
                return true;
            },
            options);
    });
}

void Feed::run_events(const std::stop_token& stop) {
    client::Client client(options_);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    run_until_stopped(stop, [&] {
        return client.watch_events(
            {},
            [this](const v1::WatchEventsResponse& response) {
                emit event_received(response.event().kind(),
                                    QString::fromStdString(response.event().message()),
                                    to_utc_ns(response.event().event_time()), response.event().subject_id());
                return true;
            },
            options);
    });
}

void Feed::run_states(const std::stop_token& stop) {
    client::ClientOptions state_options = options_;
    state_options.timeout = std::chrono::milliseconds(2000);
    client::Client client(state_options);
    std::string cameras_of;  // source and calibration of the latest ListCameras
    while (!stop.stop_requested()) {
        DaemonState state;
        state.requested_at = std::chrono::steady_clock::now();
        auto status = client.status();
        if (status.ok()) {
            if (auto recorder = client.recorder_status(); recorder.ok())
                state.recorder = std::make_shared<const v1::GetRecorderStatusResponse>(*std::move(recorder));
            if (auto replay = client.get_replay(); replay.ok())
                state.replay = std::make_shared<const v1::Replay>(replay->replay());
            const std::string source = status->source() + " " + status->active_calibration_id();
            if (source != cameras_of)
                if (auto cameras = client.cameras(); cameras.ok() && !cameras->empty()) {
                    cameras_of = source;
                    {
                        const std::scoped_lock lock(mutex_);
                        cameras_ = *std::move(cameras);
                    }
                    emit cameras_received();
                }
            state.status = std::make_shared<const v1::GetStatusResponse>(*std::move(status));
            const std::scoped_lock lock(mutex_);
            state_ = std::move(state);
            // A running capture also sends results.
            const bool running = state_.status->state() == v1::CAPTURE_STATE_RUNNING;
            if (!running || !connected_) mark_alive();
        } else {
            const std::scoped_lock lock(mutex_);
            connected_ = false;
            error_message_ = std::string(status.status().message());
            cameras_of.clear();
        }
        emit state_received();
        std::unique_lock lock(mutex_);
        wake_.wait_for(lock, stop, kStatePause, [] { return false; });
    }
}

void Feed::run_preview(const std::string& camera, PreviewKind kind, const std::stop_token& stop) {
    client::Client client(options_);
    v1::StreamPreviewsRequest request;
    request.set_camera(camera);
    request.set_kind(kind == PreviewKind::kSilhouettes ? v1::StreamPreviewsRequest::KIND_SILHOUETTE
                                                       : v1::StreamPreviewsRequest::KIND_IMAGE);
    request.set_max_width_px(kPreviewWidth_px);
    request.set_max_rate_hz(kPreviews_hz);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    run_until_stopped(stop, [&]() -> absl::Status {
        const absl::Status ended = client.stream_previews(
            request,
            [&](const client::PreviewFrame& frame) {
                const client::Image& image = frame.image;
                QImage preview;
                if (image.width > 0)
                    preview =
                        QImage(image.data.data(), image.width, image.height, image.channels * image.width,
                               image.channels == 1 ? QImage::Format_Grayscale8 : QImage::Format_RGB888)
                            .convertToFormat(QImage::Format_RGB32);  // which copies
                {
                    const std::scoped_lock lock(mutex_);
                    previews_[camera] = std::move(preview);
                }
                emit preview_received();
                return true;
            },
            options);
        if (!absl::IsPermissionDenied(ended)) return ended;
        emit previews_denied(QString::fromStdString(std::string(ended.message())));
        std::unique_lock lock(mutex_);
        wake_.wait(lock, stop, [] { return false; });
        return ended;
    });
}

}  // namespace kinevox::viewer
