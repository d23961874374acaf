// kinevox-bridge: poses for programs that people run already, over UDP.
#include <fmt/format.h>
#include <grpc/support/log.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <optional>
#include <string>

#include "client/bridge/udp_sender.h"
#include "client/bridge/vmc.h"
#include "client/lib/client.h"
#include "client/lib/connection_options.h"
#include "client/lib/pose_csv.h"
#include "client/lib/stop_signals.h"

namespace {

using namespace kinevox;
using namespace kinevox::bridge;

constexpr std::int64_t kHeadEvery_ns = 2'000'000'000;  // for receivers that come later

struct Options {
    client::ConnectionOptions connection;
    std::string to;
    double rate_hz = 0;
    bool joints = false;
};

template <typename OnPose>
int run(const Options& options, const OnPose& on_pose) {
    const std::stop_token stop = client::stop_on_signals();
    const auto connection = options.connection.open();
    if (!connection.ok()) {
        fmt::print(stderr, "kinevox-bridge: {}\n", std::string(connection.status().message()));
        return 1;
    }
    auto sender = UdpSender::open(options.to);
    if (!sender.ok()) {
        fmt::print(stderr, "kinevox-bridge: {}\n", std::string(sender.status().message()));
        return 1;
    }
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(options.rate_hz);
    client::StreamOptions stream;
    stream.reconnect = true;
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox-bridge: {}; trying again\n", std::string(why.message()));
    };
    stream.stop = stop;
    fmt::print("poses of {} go to {}\n", options.connection.server, options.to);
    std::fflush(stdout);
    const absl::Status ended = client::Client(*connection)
                                   .stream_poses(
                                       request,
                                       [&](const v1::StreamPosesResponse& message) {
                                           on_pose(message, *sender);
                                           return true;
                                       },
                                       stream);
    fmt::print("{} datagrams sent, {} dropped\n", sender->sent(), sender->dropped());
    if (absl::IsCancelled(ended)) return 0;
    fmt::print(stderr, "kinevox-bridge: {}\n", std::string(ended.message()));
    return 1;
}

int run_vmc(const Options& options) {
    std::int64_t first_ns = 0;
    return run(options, [&](const v1::StreamPosesResponse& message, UdpSender& sender) {
        const std::int64_t now_ns = message.header().capture_time_ns();
        if (first_ns == 0 || now_ns < first_ns) first_ns = now_ns;
        const double time_s = 1e-9 * static_cast<double>(now_ns - first_ns);
        const v1::Pose* const pose = message.has_pose() ? &message.pose() : nullptr;
        for (const std::string& datagram : vmc_datagrams(pose, time_s)) sender.send(datagram);
    });
}

int run_csv(const Options& options) {
    const client::PosePart part = options.joints ? client::PosePart::kJoints : client::PosePart::kAngles;
    const std::string head = client::pose_csv_head(part);
    std::optional<std::int64_t> first_ns;
    std::int64_t head_ns = 0;
    return run(options, [&](const v1::StreamPosesResponse& message, UdpSender& sender) {
        const std::int64_t now_ns = message.header().capture_time_ns();
        const bool first = !first_ns || now_ns < head_ns;  // or a replay went back
        if (first) first_ns = now_ns;
        if (first || now_ns - head_ns >= kHeadEvery_ns) {
            head_ns = now_ns;
            sender.send(head);
        }
        sender.send(client::pose_csv_line(part, message, *first_ns));
    });
}

}  // namespace

int main(int argc, char** argv) {
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors come back as statuses; one line each is enough
    Options options;
    CLI::App app("Poses of a Kinevox daemon for other programs, over UDP, until stopped.", "kinevox-bridge");
    app.require_subcommand(1);
    app.set_version_flag("--version", std::string("kinevox-bridge ") + KINEVOX_VERSION);
    app.failure_message([](const CLI::App*, const CLI::Error& error) {
        return "kinevox-bridge: " + std::string(error.what()) + "\n";
    });
    const auto add = [&](const char* name, const char* help, const std::string& to) {
        CLI::App* verb = app.add_subcommand(name, help);
        client::add_connection_options(*verb, options.connection);
        verb->add_option("--to", options.to, "HOST:PORT that the datagrams go to; else " + to);
        verb->add_option("--rate", options.rate_hz, "Poses a second at most; 0: all")
            ->check(CLI::Range(0.0, 1000.0))
            ->capture_default_str();
        return verb;
    };
    const std::string vmc_to = fmt::format("127.0.0.1:{}", kVmcPort), csv_to = "127.0.0.1:50780";
    CLI::App* vmc =
        add("vmc", "The Virtual Motion Capture protocol (OSC), for game engines and avatars", vmc_to);
    CLI::App* csv = add("csv", "A line of CSV a datagram, the columns' names every two seconds", csv_to);
    csv->add_flag("--joints", options.joints, "Joints in metres instead of angles in degrees");
    CLI11_PARSE(app, argc, argv);
    if (options.to.empty()) options.to = vmc->parsed() ? vmc_to : csv_to;
    return vmc->parsed() ? run_vmc(options) : run_csv(options);
}
