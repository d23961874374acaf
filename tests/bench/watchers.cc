// Very many subscribers in one program, each on a connection of its own: what each of them gets, and how late. Prints one
// JSON object; tests/bench/many_watchers.py starts the daemon and judges.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>
#include <absl/synchronization/mutex.h>
#include <fmt/format.h>
#include <google/protobuf/arena.h>
#include <grpcpp/grpcpp.h>
#include <sys/resource.h>

#include "kinevox/v1/stream_service.grpc.pb.h"

namespace {

using namespace kinevox;

struct Options {
    std::string server = "127.0.0.1:50770";
    int poses = 25, volumes = 25, stalled = 0;
    double seconds = 10, warm_up_s = 3, max_rate_hz = 0;
    bool lossless = false;
    double voxel_m = 0;
};

double ms_since(std::int64_t utc_ns) {
    const std::int64_t now = std::chrono::duration_cast<std::chrono::nanoseconds>(
                                 std::chrono::system_clock::now().time_since_epoch()).count();
    return 1e-6 * static_cast<double>(now - utc_ns);
}

// When the messages are counted.
std::atomic<bool> counting = false;

constexpr std::size_t kBlock = 32 << 10;

template <typename Request, typename Message>
class Watcher final : public grpc::ClientReadReactor<Message> {
  public:
    // `stalled`: subscribes, reads one message and never again.
    template <typename Begin>
    Watcher(const std::string& server, const Request& request, bool stalled, const Begin& begin)
        : request_(request), stalled_(stalled) {
        grpc::ChannelArguments arguments;
        arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);   // a connection of its own
        // They share the daemon's cores: what a thousand machines would pay for is left out.
        arguments.SetInt(GRPC_ARG_MINIMAL_STACK, 1);
        arguments.SetInt(GRPC_ARG_ENABLE_CHANNELZ, 0);
        arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
        arguments.SetMaxReceiveMessageSize(256 << 20);
        stub_ = v1::StreamService::NewStub(
            grpc::CreateCustomChannel(server, grpc::InsecureChannelCredentials(), arguments));
        begin(*stub_, &context_, &request_, this);
        read();
        this->StartCall();
    }

    void OnReadDone(bool ok) override {
        if (!ok) return;
        if (counting) {
            const auto& header = message_->header();
            ++messages;
            missed += header.missed();
            if (header.sequence() > last_ + 1 && last_ != 0) gaps += header.sequence() - last_ - 1;
            behind_ms.push_back(static_cast<float>(ms_since(header.capture_time_ns())));
            delivery_ms.push_back(static_cast<float>(ms_since(header.published_time_ns())));
        }
        last_ = message_->header().sequence();
        if (!stalled_) read();
    }
    void OnDone(const grpc::Status& status) override {
        status_ = status;
        done = true;
    }
    void stop() { context_.TryCancel(); }

    std::uint64_t messages = 0, missed = 0, gaps = 0;
    std::vector<float> behind_ms, delivery_ms;
    std::atomic<bool> done = false;
    grpc::Status status_;

  private:
    // A pose has some 150 parts: on an arena they cost one allocation.
    void read() {
        arena_.Reset();
        message_ = google::protobuf::Arena::CreateMessage<Message>(&arena_);
        this->StartRead(message_);
    }

    Request request_;
    const bool stalled_;
    std::uint64_t last_ = 0;
    grpc::ClientContext context_;
    std::unique_ptr<v1::StreamService::Stub> stub_;
    std::vector<char> block_ = std::vector<char>(kBlock);
    google::protobuf::Arena arena_{block_.data(), block_.size()};
    Message* message_ = nullptr;
};

using PoseWatcher = Watcher<v1::StreamPosesRequest, v1::StreamPosesResponse>;
using VolumeWatcher = Watcher<v1::StreamVolumesRequest, v1::StreamVolumesResponse>;

double percentile(std::vector<float>& values, double part) {
    if (values.empty()) return 0;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

template <typename Box>
std::string summary(const std::vector<std::unique_ptr<Box>>& watchers, double seconds) {
    std::uint64_t messages = 0, fewest = UINT64_MAX, missed = 0, gaps = 0, ended = 0;
    std::vector<float> behind, delivery;
    std::string why;
    for (const auto& watcher : watchers) {
        messages += watcher->messages;
        fewest = std::min(fewest, watcher->messages);
        missed += watcher->missed;
        gaps += watcher->gaps;
        if (watcher->done) ++ended, why = watcher->status_.error_message();
        behind.insert(behind.end(), watcher->behind_ms.begin(), watcher->behind_ms.end());
        delivery.insert(delivery.end(), watcher->delivery_ms.begin(), watcher->delivery_ms.end());
    }
    const auto n = static_cast<double>(std::max<std::size_t>(watchers.size(), 1));
    return fmt::format(
        R"({{"watchers":{},"messages":{},"per_second":{:.2f},"fewest_per_second":{:.2f},"missed":{},"gaps":{},"ended":{},)"
        R"("why":"{}","behind_ms":{{"p50":{:.2f},"p99":{:.2f},"max":{:.2f}}},"delivery_ms":{{"p50":{:.2f},"p99":{:.2f},"max":{:.2f}}}}})",
        watchers.size(), messages, static_cast<double>(messages) / n / seconds,
        watchers.empty() ? 0.0 : static_cast<double>(fewest) / seconds, missed, gaps, ended, why, percentile(behind, 0.5),
        percentile(behind, 0.99), percentile(behind, 1), percentile(delivery, 0.5), percentile(delivery, 0.99),
        percentile(delivery, 1));
}

}  // namespace

int main(int argc, char** argv) {
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);   // which Debian's Abseil has on
    Options options;
    CLI::App app("Subscribes many times to one daemon and tells what each got.", "watchers");
    app.add_option("--server", options.server, "HOST:PORT");
    app.add_option("--poses", options.poses, "Subscribers to poses");
    app.add_option("--volumes", options.volumes, "Subscribers to volumes");
    app.add_option("--stalled", options.stalled, "Further subscribers, to poses and volumes by turns, that stop reading");
    app.add_option("--seconds", options.seconds, "How long is counted");
    app.add_option("--warm-up", options.warm_up_s, "Seconds before");
    app.add_option("--rate", options.max_rate_hz, "Messages a second at most; 0: all");
    app.add_option("--voxel", options.voxel_m, "Edge of the volumes' voxels at most, m; 0: the capture's own");
    app.add_flag("--lossless", options.lossless, "Every message in order");
    CLI11_PARSE(app, argc, argv);
    rlimit files{};
    getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = files.rlim_max;
    setrlimit(RLIMIT_NOFILE, &files);

    const auto delivery = options.lossless ? v1::DELIVERY_LOSSLESS : v1::DELIVERY_LATEST_ONLY;
    v1::StreamPosesRequest pose_request;
    pose_request.set_delivery(delivery);
    pose_request.set_max_rate_hz(options.max_rate_hz);
    v1::StreamVolumesRequest volume_request;
    volume_request.set_delivery(delivery);
    volume_request.set_max_rate_hz(options.max_rate_hz);
    if (options.voxel_m > 0) volume_request.set_max_voxel_m(options.voxel_m);
    const auto poses_of = [](auto& stub, auto* context, auto* request, auto* reactor) {
        stub.async()->StreamPoses(context, request, reactor);
    };
    const auto volumes_of = [](auto& stub, auto* context, auto* request, auto* reactor) {
        stub.async()->StreamVolumes(context, request, reactor);
    };
    std::vector<std::unique_ptr<PoseWatcher>> poses, stalled_poses;
    std::vector<std::unique_ptr<VolumeWatcher>> volumes, stalled_volumes;
    for (int i = 0; i < options.poses; ++i)
        poses.push_back(std::make_unique<PoseWatcher>(options.server, pose_request, false, poses_of));
    for (int i = 0; i < options.volumes; ++i)
        volumes.push_back(std::make_unique<VolumeWatcher>(options.server, volume_request, false, volumes_of));
    for (int i = 0; i < options.stalled; ++i) {
        if (i % 2 == 0)
            stalled_poses.push_back(std::make_unique<PoseWatcher>(options.server, pose_request, true, poses_of));
        else
            stalled_volumes.push_back(std::make_unique<VolumeWatcher>(options.server, volume_request, true, volumes_of));
    }
    std::this_thread::sleep_for(std::chrono::duration<double>(options.warm_up_s));
    const auto begin = std::chrono::steady_clock::now();
    counting = true;
    std::this_thread::sleep_for(std::chrono::duration<double>(options.seconds));
    counting = false;
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));   // what was being counted is through
    fmt::print(R"({{"seconds":{:.2f},"poses":{},"volumes":{}}})" "\n", seconds, summary(poses, seconds), summary(volumes, seconds));
    std::fflush(stdout);

    const auto end = [](auto& watchers) {
        for (auto& watcher : watchers) watcher->stop();
    };
    end(poses), end(volumes), end(stalled_poses), end(stalled_volumes);
    const auto all_done = [](const auto& watchers) {
        return std::ranges::all_of(watchers, [](const auto& watcher) { return watcher->done.load(); });
    };
    const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!(all_done(poses) && all_done(volumes)) && std::chrono::steady_clock::now() < limit)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    // A stalled one ends with its last read, which it never asked for: the process takes it along.
    std::_Exit(0);
}
