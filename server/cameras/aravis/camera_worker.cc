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
using Trigger = LiveCamerasConfig::Trigger;

constexpr milliseconds kPatience{3000};  // at the start, before anything is named that others need to hear of
constexpr milliseconds kFirstPause{250}, kMaxPause{2000};
constexpr milliseconds kBetweenLosses{10000};  // events of one camera
constexpr milliseconds kPulse{50};             // how long at most a thread does not look up
constexpr std::size_t kPicturesInUse = 12;     // by the assembler and the pipeline, besides the queue

// So long without a sign and a camera is gone: it must be named within a second.
milliseconds max_silence(double fps) {
    return milliseconds(std::clamp<std::int64_t>(std::llround(4000 / fps), 500, 5000));
}

FrameSetAssemblerOptions assembling(const LiveCamerasConfig& config) {
    FrameSetAssemblerOptions options;
    options.cameras = config.cameras.size();
    options.fps = config.fps;
    // Cameras that run free have any phase: nearly a whole period joins all of them, and the skew is told.
    options.tolerance_ms = config.tolerance_ms > 0            ? config.tolerance_ms
                           : config.trigger == Trigger::kFree ? 900 / config.fps
                                                              : 0;
    options.max_wait_ms = config.max_wait_ms;
    options.min_pictures = static_cast<std::size_t>(config.min_cameras);
    return options;
}

// Commands a picture at each multiple of the period on the steady clock, so that all cameras' threads do it
// at once.
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
          pool_(std::size_t{3} * camera_.width * camera_.height, kPicturesInUse + shared.config.queue),
          begun_(Clock::now()) {
        // All memory that a full queue takes is taken now: the first hiccup of the machine is no time to ask
        // for it.
        std::vector<std::shared_ptr<std::uint8_t[]>> pictures(kPicturesInUse + shared.config.queue);
        for (auto& picture : pictures) std::memset((picture = pool_.take()).get(), 0, pool_.bytes());
    }

    void run() {
        milliseconds pause = kFirstPause;
        while (!stopped()) {
            auto session = connect();
            if (!session.ok()) {
                not_there(std::string(session.status().message()));
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
    void take(ArrivedPicture picture);
    void fell_silent(const std::string& why);
    void not_there(const std::string& why);
    void watch_losses();
    void update(const CameraSession& session);
    void keep(const CameraSession& session);

    bool stopped() const {
        const std::scoped_lock lock(shared_.mutex);
        return shared_.stopped;
    }
    // True: stopped.
    bool wait(milliseconds longest) {
        std::unique_lock lock(shared_.mutex);
        return shared_.changed.wait_for(lock, longest, [this] { return shared_.stopped; });
    }

    LiveCameras& shared_;
    CameraFinder& finder_;
    const std::size_t index_;
    const LiveCameraConfig& config_;
    const Camera& camera_;
    PicturePool pool_;
    const Clock::time_point begun_;
    bool delivers_ = false;  // as the others were told
    bool told_lost_ = false;
    CameraLink before_;  // figures of the connections before this one
    Clock::time_point connected_at_;
    std::uint64_t losses_told_ = 0;
    std::optional<Clock::time_point> losses_told_at_;
};

absl::StatusOr<std::unique_ptr<CameraSession>> Worker::connect() {
    const CameraFinder::List found = finder_.newest(milliseconds(300));
    const FoundCamera* chosen = choose_camera(*found, config_.device);
    if (!chosen) {
        std::string others;
        for (const FoundCamera& camera : *found) others += (others.empty() ? "" : ", ") + describe(camera);
        return absl::NotFoundError(
            fmt::format("camera {}: {} does not answer; check its cable and power; there are: {}",
                        config_.name, config_.device, others.empty() ? "no cameras" : others));
    }
    auto session = CameraSession::open(*chosen, shared_.config, config_, camera_.width, camera_.height);
    const std::scoped_lock lock(shared_.mutex);
    shared_.links[index_].device = describe(*chosen);
    return session;
}

void Worker::read(CameraSession& session) {
    std::optional<TriggerThread> trigger;
    if (shared_.config.trigger == Trigger::kSoftware) trigger.emplace(session, shared_.config.fps);
    const milliseconds silence = max_silence(shared_.config.fps);
    Clock::time_point heard = Clock::now(), looked = heard;
    while (!stopped()) {
        ArrivedPicture arrived;
        const auto outcome = session.next(kPulse, pool_, arrived);
        const Clock::time_point now = Clock::now();
        if (outcome == CameraSession::Outcome::kPicture) {
            heard = now;
            take(std::move(arrived));
        } else if (session.control_lost()) {
            return fell_silent("its connection is gone");
        } else if (now - heard > silence) {
            fell_silent("it delivers no pictures");
            if (!session.answers()) return;
            not_there(
                "it answers, but delivers no pictures; see that it is triggered and that nothing between it "
                "and "
                "this machine drops UDP packets");
            heard = Clock::now();
        }
        if (now - looked > std::chrono::seconds(1)) {
            looked = now;
            session.look_at_clock();
            update(session);
            watch_losses();
        }
    }
}

void Worker::take(ArrivedPicture picture) {
    picture.camera = index_;
    bool rejoined = false;
    {
        const std::scoped_lock lock(shared_.mutex);
        if (!delivers_) {
            shared_.assembler.connect(index_);
            shared_.links[index_].problem.clear();
            rejoined = std::exchange(told_lost_, false);
            delivers_ = true;
            connected_at_ = Clock::now();
        }
    }
    // First the word, then the picture: what follows from it is told after it.
    if (rejoined)
        shared_.tell(CameraEvent::Kind::kRejoined, index_,
                     fmt::format("camera {} is back and delivers pictures", config_.name));
    const std::scoped_lock lock(shared_.mutex);
    shared_.assembler.add(std::move(picture));
    shared_.collect();
    shared_.changed.notify_all();
}

void Worker::fell_silent(const std::string& why) {
    if (!delivers_) return;
    delivers_ = false;
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.assembler.disconnect(index_);
        ++shared_.links[index_].disconnects;
        shared_.links[index_].problem = fmt::format("camera {}: {}", config_.name, why);
        shared_.changed.notify_all();
    }
    told_lost_ = true;
    shared_.tell(CameraEvent::Kind::kLost, index_,
                 fmt::format("camera {} is lost: {}; the others go on, it is looked for", config_.name, why));
}

void Worker::not_there(const std::string& why) {
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.links[index_].problem = why;
    }
    if (told_lost_ || Clock::now() - begun_ < kPatience) return;
    told_lost_ = true;
    shared_.tell(CameraEvent::Kind::kLost, index_, why);
}

void Worker::watch_losses() {
    CameraLink link;
    {
        const std::scoped_lock lock(shared_.mutex);
        shared_.assembler.fill(index_, link);
    }
    const std::uint64_t losses = link.lost + link.incomplete + link.late;
    const Clock::time_point now = Clock::now();
    // Until the cameras and their buffers have found their pace something goes amiss that nobody needs to
    // hear of.
    if (now - connected_at_ < kPatience) losses_told_ = losses;
    if (losses == losses_told_ || (losses_told_at_ && now - *losses_told_at_ < kBetweenLosses)) return;
    shared_.tell(CameraEvent::Kind::kLosses, index_,
                 fmt::format("camera {}: of {} pictures {} never arrived, {} in part and {} too late; see "
                             "the network settings "
                             "in docs/cameras.md",
                             config_.name, link.pictures + losses, link.lost, link.incomplete, link.late));
    losses_told_ = losses;
    losses_told_at_ = now;
}

void Worker::update(const CameraSession& session) {
    CameraLink now;
    session.fill(now);
    const std::scoped_lock lock(shared_.mutex);
    CameraLink& link = shared_.links[index_];
    link.packet_bytes = now.packet_bytes;
    for (std::uint64_t CameraLink::*figure : {&CameraLink::packets_missing, &CameraLink::packets_resent,
                                              &CameraLink::resend_requests, &CameraLink::underruns})
        link.*figure = before_.*figure + now.*figure;
}

void Worker::keep(const CameraSession& session) {
    update(session);
    const std::scoped_lock lock(shared_.mutex);
    before_ = shared_.links[index_];
}

}  // namespace

LiveCameras::LiveCameras(const LiveCamerasConfig& given, std::vector<Camera> calibrated)
    : config(given),
      cameras(std::move(calibrated)),
      assembler(assembling(given)),
      links(given.cameras.size()) {}

void LiveCameras::collect() {
    const std::int64_t now_ns =
        std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
    while (auto set = assembler.take(now_ns)) {
        ready.push_back(std::move(*set));
        if (ready.size() > static_cast<std::size_t>(config.queue)) ready.pop_front();
    }
}

void LiveCameras::tell(CameraEvent::Kind kind, std::size_t camera, std::string message) {
    const std::scoped_lock lock(event_mutex);
    if (on_event) on_event({kind, camera, std::move(message)});
}

CameraFinder::List CameraFinder::newest(milliseconds at_most_old) {
    const Clock::time_point asked = Clock::now();
    const std::scoped_lock lock(mutex_);
    // Also what somebody else asked for while this thread waited.
    if (!list_ || at_ < asked - at_most_old) {
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
