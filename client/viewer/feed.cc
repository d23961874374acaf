#include "client/viewer/feed.h"

#include <algorithm>
#include <utility>

#include "common/body_pose.h"

namespace kinevox::viewer {
namespace {

constexpr double kMaxVolumes_hz = 30, kPreviews_hz = 5;
constexpr int kPreviewWidth_px = 320;
constexpr std::size_t kMaxPoses = 512;
constexpr std::chrono::milliseconds kStatePause{250}, kRetryPause{500};

ShownPose shown(const v1::StreamPosesResponse& message) {
    ShownPose pose;
    pose.sequence = message.header().sequence();
    pose.capture_time_ns = message.header().capture_time_ns();
    if (message.header().has_recorded_frame()) pose.recorded_frame = message.header().recorded_frame();
    pose.found = message.has_pose();
    for (const v1::JointEstimate& joint : message.pose().joints())
        if (const auto place = joint_index(joint.name()); place && joint.has_position_in_world()) {
            const v1::Vec3& p = joint.position_in_world();
            pose.joints_in_world[*place] = Vec3{p.x(), p.y(), p.z()};
        }
    for (const v1::AngleEstimate& angle : message.pose().angles())
        pose.angles.push_back(
            {angle.name(), angle.has_value_deg() ? std::optional(angle.value_deg()) : std::nullopt});
    return pose;
}

ShownVolume shown(const client::VolumeFrame& frame) {
    ShownVolume volume;
    volume.sequence = frame.header.sequence();
    volume.capture_time_ns = frame.header.capture_time_ns();
    if (frame.header.has_recorded_frame()) volume.recorded_frame = frame.header.recorded_frame();
    volume.litres = frame.litres;
    if (frame.volume) {
        volume.points = surface_points(*frame.volume);
        volume.voxel_m = frame.volume->grid.voxel_m;
    }
    if (frame.subject) {
        const v1::Vec3& c = frame.subject->centre_in_world();
        volume.subject_in_world = Vec3{c.x(), c.y(), c.z()};
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

std::vector<std::shared_ptr<const ShownPose>> Feed::take_poses() {
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

Link Feed::link() const {
    const std::scoped_lock lock(mutex_);
    Link link;
    link.server = options_.server;
    link.connected = connected_;
    link.problem = problem_;
    link.silent_s = std::chrono::duration<double>(Clock::now() - last_message_).count();
    return link;
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

void Feed::alive() {
    last_message_ = Clock::now();
    connected_ = true;
    problem_.clear();
}

// A stream that ends by itself, with the daemon or refused by it, is begun again after a pause.
void Feed::until(const std::stop_token& stop, const std::function<absl::Status()>& stream) {
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
    until(stop, [&] {
        return client.stream_volumes(
            request,
            [this](const client::VolumeFrame& frame) {
                auto volume = std::make_shared<const ShownVolume>(shown(frame));
                {
                    const std::scoped_lock lock(mutex_);
                    volume_ = std::move(volume);
                    alive();
                }
                emit volume_came();
                return true;
            },
            options);
    });
}

void Feed::run_poses(const std::stop_token& stop) {
    client::Client client(options_);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    until(stop, [&] {
        return client.stream_poses(
            {},
            [this](const v1::StreamPosesResponse& message) {
                auto pose = std::make_shared<const ShownPose>(shown(message));
                {
                    const std::scoped_lock lock(mutex_);
                    if (poses_.size() >= kMaxPoses) poses_.erase(poses_.begin());
                    poses_.push_back(std::move(pose));
                    alive();
                }
                emit poses_came();
                return true;
            },
            options);
    });
}

void Feed::run_events(const std::stop_token& stop) {
    client::Client client(options_);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    until(stop, [&] {
        return client.watch_events(
            {},
            [this](const v1::WatchEventsResponse& event) {
                emit event_came(event.kind(), QString::fromStdString(event.message()), event.time_ns());
                return true;
            },
            options);
    });
}

void Feed::run_states(const std::stop_token& stop) {
    client::ClientOptions impatient = options_;
    impatient.timeout = std::chrono::milliseconds(2000);
    client::Client client(impatient);
    std::string cameras_of;  // the source that the cameras were asked for
    while (!stop.stop_requested()) {
        DaemonState state;
        state.asked_at = Clock::now();
        auto status = client.status();
        if (status.ok()) {
            if (auto recorder = client.recorder_status(); recorder.ok())
                state.recorder = std::make_shared<const v1::GetRecorderStatusResponse>(*std::move(recorder));
            if (auto replay = client.get_replay(); replay.ok())
                state.replay = std::make_shared<const v1::Replay>(replay->replay());
            const std::string source = status->source() + " " + status->calibration_id();
            if (source != cameras_of)
                if (auto cameras = client.cameras(); cameras.ok() && !cameras->empty()) {
                    cameras_of = source;
                    {
                        const std::scoped_lock lock(mutex_);
                        cameras_ = *std::move(cameras);
                    }
                    emit cameras_came();
                }
            state.status = std::make_shared<const v1::GetStatusResponse>(*std::move(status));
            const std::scoped_lock lock(mutex_);
            state_ = std::move(state);
            // A capture that runs sends more than this.
            const bool runs = state_.status->state() == v1::CAPTURE_STATE_RUNNING;
            if (!runs || !connected_) alive();
        } else {
            const std::scoped_lock lock(mutex_);
            connected_ = false;
            problem_ = std::string(status.status().message());
            cameras_of.clear();
        }
        emit state_came();
        std::unique_lock lock(mutex_);
        wake_.wait_for(lock, stop, kStatePause, [] { return false; });
    }
}

void Feed::run_preview(const std::string& camera, PreviewKind kind, const std::stop_token& stop) {
    client::Client client(options_);
    v1::StreamPreviewsRequest request;
    request.set_camera(camera);
    request.set_kind(kind == PreviewKind::kSilhouettes ? v1::StreamPreviewsRequest::KIND_SILHOUETTE
                                                       : v1::StreamPreviewsRequest::KIND_PICTURE);
    request.set_max_width_px(kPreviewWidth_px);
    request.set_max_rate_hz(kPreviews_hz);
    const client::StreamOptions options{.reconnect = true, .on_reconnect = {}, .stop = stop};
    until(stop, [&]() -> absl::Status {
        const absl::Status ended = client.stream_previews(
            request,
            [&](const client::PreviewFrame& frame) {
                const client::Image& image = frame.image;
                QImage picture;
                if (image.width > 0)
                    picture =
                        QImage(image.data.data(), image.width, image.height, image.channels * image.width,
                               image.channels == 1 ? QImage::Format_Grayscale8 : QImage::Format_RGB888)
                            .convertToFormat(QImage::Format_RGB32);  // which copies
                {
                    const std::scoped_lock lock(mutex_);
                    previews_[camera] = std::move(picture);
                }
                emit preview_came();
                return true;
            },
            options);
        if (!absl::IsPermissionDenied(ended)) return ended;
        emit previews_refused(QString::fromStdString(std::string(ended.message())));
        std::unique_lock lock(mutex_);
        wake_.wait(lock, stop, [] { return false; });
        return ended;
    });
}

}  // namespace kinevox::viewer
