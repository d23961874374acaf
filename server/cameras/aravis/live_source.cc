#include "server/cameras/aravis/live_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <thread>
#include <vector>

#include "common/calibration_file.h"
#include "server/cameras/aravis/camera_worker.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kMaxShutdown{1500};

class LiveSource final : public FrameSource {
  public:
    explicit LiveSource(std::shared_ptr<LiveCameras> shared) : shared_(std::move(shared)) {}

    ~LiveSource() override {
        stop();
        {
            const std::scoped_lock lock(shared_->event_mutex);
            shared_->on_event = nullptr;
        }
        std::unique_lock lock(shared_->mutex);
        shared_->changed.wait_for(lock, kMaxShutdown, [this] { return shared_->running == 0; });
        const bool all_ended = shared_->running == 0;
        lock.unlock();
        for (std::thread& thread : threads_) {
            if (all_ended)
                thread.join();
            else
                thread.detach();  // blocked in an unresponsive camera; it owns what it uses
        }
    }

    const std::vector<Camera>& cameras() const override { return shared_->cameras; }
    double fps() const override { return shared_->config.fps; }
    std::int64_t frame_count() const override { return -1; }
    absl::StatusOr<std::vector<std::vector<Image>>> background() override {
        return std::vector<std::vector<Image>>{};
    }

    absl::StatusOr<FrameSet> next() override {
        std::unique_lock lock(shared_->mutex);
        if (!started_) start();
        for (;;) {
            if (shared_->stopped) return absl::CancelledError("the cameras were stopped");
            shared_->collect();
            if (!shared_->ready.empty()) {
                FrameSet set = std::move(shared_->ready.front());
                shared_->ready.pop_front();
                return set;
            }
            if (const auto due_ns = shared_->assembler.due_ns())
                shared_->changed.wait_until(lock, Clock::time_point(std::chrono::nanoseconds(*due_ns)));
            else
                shared_->changed.wait(lock);
        }
    }

    void stop() override {
        const std::scoped_lock lock(shared_->mutex);
        shared_->stopped = true;
        shared_->changed.notify_all();
    }

    std::vector<CameraConnection> camera_connections() const override {
        const std::scoped_lock lock(shared_->mutex);
        std::vector<CameraConnection> links = shared_->links;
        for (std::size_t c = 0; c < links.size(); ++c) {
            shared_->assembler.fill(c, links[c]);
            if (!links[c].connected && links[c].error_message.empty())
                links[c].error_message = fmt::format("searching for camera {}", shared_->cameras[c].name);
        }
        return links;
    }

    void set_on_camera_event(OnCameraEvent on_event) override {
        const std::scoped_lock lock(shared_->event_mutex);
        shared_->on_event = std::move(on_event);
    }

  private:
    void start() {
        started_ = true;
        auto finder = std::make_shared<CameraFinder>();
        shared_->running = shared_->cameras.size();
        for (std::size_t c = 0; c < shared_->cameras.size(); ++c)
            threads_.emplace_back(run_camera, shared_, finder, c);
    }

    const std::shared_ptr<LiveCameras> shared_;
    std::vector<std::thread> threads_;
    bool started_ = false;  // guarded by shared_->mutex
};

}  // namespace

absl::StatusOr<std::unique_ptr<FrameSource>> open_live_source(const LiveSourceConfig& config) {
    auto calibrated = read_calibration(config.calibration_file);
    if (!calibrated.ok()) return calibrated.status();
    std::vector<Camera> cameras;
    for (const LiveCameraConfig& wanted : config.cameras) {
        const auto at = std::ranges::find(*calibrated, wanted.name, &Camera::name);
        if (at == calibrated->end())
            return absl::NotFoundError(
                fmt::format("{}: no camera '{}', which [[source.cameras.camera]] names; calibrate it "
                            "or correct the name",
                            config.calibration_file.string(), wanted.name));
        cameras.push_back(*at);
    }
    return std::make_unique<LiveSource>(std::make_shared<LiveCameras>(config, std::move(cameras)));
}

}  // namespace kinevox
