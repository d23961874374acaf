#include "server/cameras/aravis/live_source.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <thread>
#include <vector>

#include "common/calibration_file.h"
#include "server/cameras/aravis/aravis_camera.h"
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

// Aravis opens a GigE camera by this name but does not list it, so it is read by GVCP (READMEM of the
// bootstrap register), which needs no control of the camera. Empty if it does not answer in time.
std::string user_name_of(const std::string& address) {
    constexpr std::uint16_t kControlPort = 3956;
    constexpr std::size_t kNameBytes = 16, kHeaderBytes = 8;
    // Acknowledge, READMEM, 8 bytes, number 1; register 0xe8, 16 bytes.
    static constexpr std::uint8_t kAsk[] = {0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 0, 0xe8, 0, 0, 0, kNameBytes};
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(kControlPort);
    if (inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) return {};
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return {};
    std::string name;
    std::uint8_t answer[64];
    pollfd wait{fd, POLLIN, 0};
    if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
        send(fd, kAsk, sizeof kAsk, 0) > 0 && poll(&wait, 1, 100) == 1) {
        const ssize_t bytes = recv(fd, answer, sizeof answer, 0);
        const bool fine =
            bytes >= static_cast<ssize_t>(kHeaderBytes + 4 + kNameBytes) && answer[0] == 0 && answer[1] == 0;
        if (fine) {
            const auto* begin = reinterpret_cast<const char*>(answer) + kHeaderBytes + 4;
            name.assign(begin, std::find(begin, begin + kNameBytes, '\0'));
        }
    }
    close(fd);
    return name;
}

}  // namespace

std::mutex& aravis_list_mutex() {
    static std::mutex mutex;  // one, as Aravis has one list
    return mutex;
}

std::vector<FoundCamera> discover_cameras() {
    const std::scoped_lock lock(aravis_list_mutex());
    arv_debug_enable("all:0");  // its messages are also returned as errors
    arv_update_device_list();
    std::vector<FoundCamera> found;
    for (unsigned i = 0; i < arv_get_n_devices(); ++i)
        found.push_back({text_of(arv_get_device_id(i)),
                         text_of(arv_get_device_physical_id(i)),
                         text_of(arv_get_device_address(i)),
                         text_of(arv_get_device_vendor(i)),
                         text_of(arv_get_device_model(i)),
                         text_of(arv_get_device_serial_nbr(i)),
                         {},
                         text_of(arv_get_device_protocol(i))});
    for (FoundCamera& camera : found)
        if (camera.protocol == "GigEVision") camera.user_name = user_name_of(camera.address);
    std::ranges::sort(found, {}, &FoundCamera::id);
    return found;
}

const FoundCamera* choose_camera(const std::vector<FoundCamera>& found, const std::string& device) {
    for (std::string FoundCamera::*key : {&FoundCamera::serial, &FoundCamera::user_name, &FoundCamera::id,
                                          &FoundCamera::address, &FoundCamera::physical_id})
        if (const auto at = std::ranges::find(found, device, key); at != found.end()) return &*at;
    return nullptr;
}

std::string describe(const FoundCamera& camera) {
    std::string text = fmt::format("{} {} {}", camera.vendor, camera.model, camera.serial);
    if (!camera.address.empty()) text += " at " + camera.address;
    return text;
}

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
