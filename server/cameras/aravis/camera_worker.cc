#include "server/cameras/aravis/camera_worker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <optional>
#include <thread>
#include <utility>

#include "server/cameras/aravis/camera_session.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using Trigger = LiveSourceConfig::Trigger;

constexpr milliseconds kStartupGrace{3000};  // no events in this time after the start
constexpr milliseconds kFirstPause{250}, kMaxPause{2000};
constexpr milliseconds kLossEventInterval{10000};  // per camera
constexpr milliseconds kPollInterval{50};  // maximum wait for an image before the state is checked again
constexpr std::size_t kImagesInUse = 12;   // held by the assembler and the pipeline, besides the queue

// Time without an image after which a camera counts as disconnected; an event is due within a second.
milliseconds idle_timeout(double fps) {
    return milliseconds(std::clamp<std::int64_t>(std::llround(4000 / fps), 500, 5000));
}

FrameSetAssemblerOptions assembling(const LiveSourceConfig& config) {
    FrameSetAssemblerOptions options;
    options.camera_count = config.cameras.size();
    options.fps = config.fps;
    // Free-running cameras have an arbitrary phase: nearly a whole period joins all of them; the skew is
    // reported.
    options.match_tolerance_ms = config.match_tolerance_ms > 0         ? config.match_tolerance_ms
                                 : config.trigger == Trigger::kFreeRun ? 900 / config.fps
                                                                       : 0;
    options.max_wait_ms = config.max_wait_ms;
    options.min_images = static_cast<std::size_t>(config.min_cameras);
    return options;
}

// Triggers at each multiple of the period on the steady clock, so that the threads of all cameras trigger
// simultaneously.
class TriggerThread {
  public:
    TriggerThread(CameraSession& session, double fps)
        : thread_([&session, fps](const std::stop_token& stop) {
              const auto period = std::chrono::nanoseconds(std::llround(1e9 / fps));
              while (!stop.stop_requested()) {
                  const auto now = Clock::now().time_since_epoch();
                  std::this_thread::sleep_until(Clock::time_point((now / period + 1) * period));
                  if (!stop.stop_requested()) session.trigger();
              }
          }) {}

  private:
    std::jthread thread_;
};

class Worker {
  public:
    Worker(LiveCameras& shared, CameraFinder& finder, std::size_t index)
        : shared_(shared),
          finder_(finder),
          index_(index),
          config_(shared.config.cameras[index]),
          camera_(shared.cameras[index]),
          pool_(std::size_t{3} * camera_.width * camera_.height,
                kImagesInUse + shared.config.max_queued_frame_sets),
          begun_(Clock::now()) {
        // Allocates and touches the memory of a full queue now: page faults under load would cost images.
        std::vector<std::shared_ptr<std::uint8_t[]>> images(kImagesInUse +
                                                            shared.config.max_queued_frame_sets);
        for (auto& image : images) std::memset((image = pool_.take()).get(), 0, pool_.bytes());
    }

    void run() {
        milliseconds pause = kFirstPause;
        while (!stopped()) {
            auto session = connect();
            if (!session.ok()) {
                report_unavailable(std::string(session.status().message()));
                if (wait(pause)) return;
                pause = std::min(2 * pause, kMaxPause);
                continue;
            }
            pause = kFirstPause;
            read(**session);
            keep(**session);
        }
    }

  private:
    absl::StatusOr<std::unique_ptr<CameraSession>> connect();
    void read(CameraSession& session);
    void take(ArrivedImage image);
    void report_disconnected(const std::string& why);
    void report_unavailable(const std::string& why);
    void report_losses();
    void update(const CameraSession& session);
    void keep(const CameraSession& session);

    bool stopped() const {
        const std::scoped_lock lock(shared_.mutex);
        return shared_.stopped;
    }
    // True: stopped.
    bool wait(milliseconds duration) {
        std::unique_lock lock(shared_.mutex);
        return shared_.changed.wait_for(lock, duration, [this] { return shared_.stopped; });
    }

    LiveCameras& shared_;
    CameraFinder& finder_;
    const std::size_t index_;
    const LiveCameraConfig& config_;
    const Camera& camera_;
    ImagePool pool_;
    const Clock::time_point begun_;
    bool delivers_ = false;  // as last reported
    bool reported_lost_ = false;
    CameraConnection before_;  // counts of the previous connections
    Clock::time_point connected_at_;
    std::uint64_t losses_reported_ = 0;
    std::optional<Clock::time_point> losses_reported_at_;
};

absl::StatusOr<std::unique_ptr<CameraSession>> Worker::connect() {
    const CameraFinder::List found = finder_.latest(milliseconds(300));
    const FoundCamera* chosen = choose_camera(*found, config_.device);
    if (!chosen) {
        std::string others;
        for (const FoundCamera& camera : *found) others += (others.empty() ? "" : ", ") + describe(camera);
        return absl::NotFoundError(
            fmt::format("camera {}: {} does not answer; check its cable and power; cameras found: {}",
                        config_.name, config_.device, others.empty() ? "none" : others));
    }
    auto session = CameraSession::open(*chosen, shared_.config, config_, camera_.width, camera_.height);
    const std::scoped_lock lock(shared_.mutex);
    shared_.links[index_].device = describe(*chosen);
    return session;
}

void Worker::read(CameraSession& session) {
    std::optional<TriggerThread> trigger;
    if (shared_.config.trigger == Trigger::kSoftware) trigger.emplace(session, shared_.config.fps);
    const milliseconds timeout = idle_timeout(shared_.config.fps);
    Clock::time_point last_image = Clock::now(), last_check = last_image;
    while (!stopped()) {
        ArrivedImage arrived;
        const auto outcome = session.next(kPollInterval, pool_, arrived);
        const Clock::time_point now = Clock::now();
        if (outcome == CameraSession::Outcome::kImage) {
            last_image = now;
            take(std::move(arrived));
        } else if (session.control_lost()) {
            return report_disconnected("the connection was lost");
        } else if (now - last_image > timeout) {
            report_disconnected("no images");
            if (!session.answers()) return;
            report_unavailable(
                "it answers but delivers no images; check its trigger, and the network for dropped UDP "
                "packets");
            last_image = Clock::now();
        }
        if (now - last_check > std::chrono::seconds(1)) {
            last_check = now;
            session.update_clock();
            update(session);
            report_losses();
        }
    }
}

void Worker::take(ArrivedImage image) {
    image.camera = index_;
    bool reconnected = false;
    {
        const std::scoped_lock lock(shared_.mutex);
        if (!delivers_) {
            shared_.assembler.connect(index_);
            shared_.links[index_].error_message.clear();
            reconnected = std::exchange(reported_lost_, false);
            delivers_ = true;
            connected_at_ = Clock::now();
        }
    }
    // The event precedes the image, so that events caused by the image follow it.
    if (reconnected)
        shared_.publish_event(CameraEvent::Kind::kReconnected, index_,
                              fmt::format("camera {} reconnected and delivers images", config_.name));
    const std::scoped_lock lock(shared_.mutex);
    shared_.assembler.add(std::move(image));
    shared_.collect();
    shared_.changed.notify_all();
}

void Worker::report_disconnected(const std::string& why) {
    if (!delivers_) return;
    delivers_ = false;
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.assembler.disconnect(index_);
        ++shared_.links[index_].disconnect_count;
        shared_.links[index_].error_message = fmt::format("camera {}: {}", config_.name, why);
        shared_.changed.notify_all();
    }
    reported_lost_ = true;
    shared_.publish_event(
        CameraEvent::Kind::kDisconnected, index_,
        fmt::format("camera {} disconnected: {}; reconnecting, other cameras continue", config_.name, why));
}

void Worker::report_unavailable(const std::string& why) {
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.links[index_].error_message = why;
    }
    if (reported_lost_ || Clock::now() - begun_ < kStartupGrace) return;
    reported_lost_ = true;
    shared_.publish_event(CameraEvent::Kind::kDisconnected, index_, why);
}

void Worker::report_losses() {
    CameraConnection link;
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.assembler.fill(index_, link);
    }
    const std::uint64_t losses = link.lost_image_count + link.incomplete_image_count + link.late_image_count;
    const Clock::time_point now = Clock::now();
    // Losses while the cameras and their buffers start up are not reported.
    if (now - connected_at_ < kStartupGrace) losses_reported_ = losses;
    if (losses == losses_reported_ ||
        (losses_reported_at_ && now - *losses_reported_at_ < kLossEventInterval))
        return;
    shared_.publish_event(
        CameraEvent::Kind::kImagesLost, index_,
        fmt::format("camera {}: of {} images {} were lost, {} incomplete and {} late; see the network "
                    "settings in docs/cameras.md",
                    config_.name, link.image_count + losses, link.lost_image_count,
                    link.incomplete_image_count, link.late_image_count));
    losses_reported_ = losses;
    losses_reported_at_ = now;
}

void Worker::update(const CameraSession& session) {
    CameraConnection now;
    session.fill(now);
    const std::scoped_lock lock(shared_.mutex);
    CameraConnection& link = shared_.links[index_];
    link.packet_size_bytes = now.packet_size_bytes;
    for (std::uint64_t CameraConnection::*count :
         {&CameraConnection::missing_packet_count, &CameraConnection::resent_packet_count,
          &CameraConnection::resend_request_count, &CameraConnection::buffer_underrun_count})
        link.*count = before_.*count + now.*count;
}

void Worker::keep(const CameraSession& session) {
    update(session);
    const std::scoped_lock lock(shared_.mutex);
    before_ = shared_.links[index_];
}

}  // namespace

LiveCameras::LiveCameras(const LiveSourceConfig& given, std::vector<Camera> calibrated)
    : config(given),
      cameras(std::move(calibrated)),
      assembler(assembling(given)),
      links(given.cameras.size()) {}

void LiveCameras::collect() {
    const std::int64_t now_ns =
        std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
    while (auto set = assembler.take(now_ns)) {
        ready.push_back(std::move(*set));
        if (ready.size() > static_cast<std::size_t>(config.max_queued_frame_sets)) ready.pop_front();
    }
}

void LiveCameras::publish_event(CameraEvent::Kind kind, std::size_t camera, std::string message) {
    const std::scoped_lock lock(event_mutex);
    if (on_event) on_event({kind, camera, std::move(message)});
}

CameraFinder::List CameraFinder::latest(milliseconds max_age) {
    const Clock::time_point requested = Clock::now();
    const std::scoped_lock lock(mutex_);
    // A list that another thread requested while this one waited for the lock is recent enough.
    if (!list_ || at_ < requested - max_age) {
        const Clock::time_point begin = Clock::now();
        list_ = std::make_shared<const std::vector<FoundCamera>>(discover_cameras());
        at_ = begin;
    }
    return list_;
}

void run_camera(std::shared_ptr<LiveCameras> cameras, std::shared_ptr<CameraFinder> finder,
                std::size_t index) {
    Worker(*cameras, *finder, index).run();
    const std::scoped_lock lock(cameras->mutex);
    --cameras->running;
    cameras->changed.notify_all();
}

}  // namespace kinevox
