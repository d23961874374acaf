// Very many subscribers in one program, each on a connection of its own: what each of them gets, and how
// late. Prints one JSON object; tests/bench/many_watchers.py starts the daemon and judges.
#include <absl/synchronization/mutex.h>
#include <fmt/format.h>
#include <sys/resource.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "common/stopwatch.h"
#include "tests/bench/grpc_watcher.h"
#include "tests/bench/http2_watcher.h"

namespace {

using namespace kinevox;
using namespace kinevox::bench;

struct Options {
    std::string server = "127.0.0.1:50770";
    int poses = 25, volumes = 25, stalled = 0;
    double seconds = 10, warm_up_s = 3, max_rate_hz = 0;
    bool lossless = false, grpc = false;
    double voxel_m = 0;
};

using Watchers = std::vector<std::unique_ptr<Watcher>>;

std::string path(const char* method) {
    return fmt::format("/{}/{}", v1::StreamService::service_full_name(), method);
}

double percentile(std::vector<float>& values, double part) {
    if (values.empty()) return 0;
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

std::string summary(const Watchers& watchers, double seconds) {
    std::uint64_t messages = 0, fewest = UINT64_MAX, missed = 0, gaps = 0, ended = 0;
    std::vector<float> behind, delivery;
    std::string why;
    for (const auto& watcher : watchers) {
        const Watched& of = watcher->watched;
        messages += of.messages;
        fewest = std::min(fewest, of.messages);
        missed += of.missed;
        gaps += of.gaps;
        if (of.ended) ++ended, why = of.why;
        behind.insert(behind.end(), of.behind_ms.begin(), of.behind_ms.end());
        delivery.insert(delivery.end(), of.delivery_ms.begin(), of.delivery_ms.end());
    }
    const auto n = static_cast<double>(std::max<std::size_t>(watchers.size(), 1));
    return fmt::format(
        R"({{"watchers":{},"messages":{},"per_second":{:.2f},"min_per_second":{:.2f},"missed":{},"gaps":{},"ended":{},)"
        R"("why":"{}","behind_ms":{{"p50":{:.2f},"p99":{:.2f},"max":{:.2f}}},"delivery_ms":{{"p50":{:.2f},"p99":{:.2f},"max":{:.2f}}}}})",
        watchers.size(), messages, static_cast<double>(messages) / n / seconds,
        watchers.empty() ? 0.0 : static_cast<double>(fewest) / seconds, missed, gaps, ended, why,
        percentile(behind, 0.5), percentile(behind, 0.99), percentile(behind, 1), percentile(delivery, 0.5),
        percentile(delivery, 0.99), percentile(delivery, 1));
}

}  // namespace

int main(int argc, char** argv) {
    absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);  // which Debian's Abseil has on
    Options options;
    CLI::App app("Subscribes many times to one daemon and reports what each received.", "watchers");
    app.add_option("--server", options.server, "HOST:PORT");
    app.add_option("--poses", options.poses, "Subscribers to poses");
    app.add_option("--volumes", options.volumes, "Subscribers to volumes");
    app.add_option("--stalled", options.stalled,
                   "Further subscribers, to poses and volumes by turns, that stop reading");
    app.add_option("--seconds", options.seconds, "How long is counted");
    app.add_option("--warm-up", options.warm_up_s, "Seconds before");
    app.add_option("--rate", options.max_rate_hz, "Messages a second at most; 0: all");
    app.add_option("--voxel", options.voxel_m,
                   "Edge of the volumes' voxels at most, m; 0: the capture's own");
    app.add_flag("--grpc", options.grpc, "Clients of gRPC's own library, which take more of the processor");
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
    boost::asio::io_context io;
    auto working = boost::asio::make_work_guard(io);
    std::thread reading([&io] { io.run(); });
    const auto poses_of = [&](bool stalled) -> std::unique_ptr<Watcher> {
        if (!options.grpc)
            return std::make_unique<Http2Watcher<v1::StreamPosesResponse>>(
                io, options.server, path("StreamPoses"), pose_request.SerializeAsString(), stalled);
        return std::make_unique<GrpcWatcher<v1::StreamPosesRequest, v1::StreamPosesResponse>>(
            options.server, pose_request, stalled,
            [](auto& stub, auto* context, auto* request, auto* reactor) {
                stub.async()->StreamPoses(context, request, reactor);
            });
    };
    const auto volumes_of = [&](bool stalled) -> std::unique_ptr<Watcher> {
        if (!options.grpc)
            return std::make_unique<Http2Watcher<v1::StreamVolumesResponse>>(
                io, options.server, path("StreamVolumes"), volume_request.SerializeAsString(), stalled);
        return std::make_unique<GrpcWatcher<v1::StreamVolumesRequest, v1::StreamVolumesResponse>>(
            options.server, volume_request, stalled,
            [](auto& stub, auto* context, auto* request, auto* reactor) {
                stub.async()->StreamVolumes(context, request, reactor);
            });
    };
    Watchers poses, volumes, stalled;
    for (int i = 0; i < options.poses; ++i) poses.push_back(poses_of(false));
    for (int i = 0; i < options.volumes; ++i) volumes.push_back(volumes_of(false));
    for (int i = 0; i < options.stalled; ++i)
        stalled.push_back(i % 2 == 0 ? poses_of(true) : volumes_of(true));
    std::this_thread::sleep_for(std::chrono::duration<double>(options.warm_up_s));
    const Stopwatch counted;
    counting = true;
    std::this_thread::sleep_for(std::chrono::duration<double>(options.seconds));
    counting = false;
    const double seconds = counted.seconds();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));  // what was being counted is through
    fmt::print(R"({{"seconds":{:.2f},"poses":{},"volumes":{}}})"
               "\n",
               seconds, summary(poses, seconds), summary(volumes, seconds));
    std::fflush(stdout);

    for (Watchers* all : {&poses, &volumes, &stalled})
        for (auto& watcher : *all) watcher->stop();
    const auto all_ended = [](const Watchers& watchers) {
        return std::ranges::all_of(watchers,
                                   [](const auto& watcher) { return watcher->watched.ended.load(); });
    };
    const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(20);
    while (!(all_ended(poses) && all_ended(volumes)) && std::chrono::steady_clock::now() < limit)
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    // A stalled one of gRPC's ends with its last read, which it never asked for: the process takes it along.
    std::_Exit(0);
}
