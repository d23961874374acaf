// kinevox-bridge: poses over UDP, for game engines and other programs.
#include <fmt/format.h>
#include <grpc/support/log.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <optional>
#include <string>
#include <vector>

#include "client/bridge/datagrams.h"
#include "client/lib/client.h"
#include "client/lib/client_program.h"
#include "client/lib/pose_csv.h"
#include "common/command_line.h"

namespace {

using namespace kinevox;
using namespace kinevox::bridge;

constexpr std::int64_t kHeaderInterval_ns = 2'000'000'000;  // for receivers that start later

struct Options {
    client::ConnectionOptions connection;
    std::string to, content = "angles";
    double max_rate_hz = 0;
    std::uint32_t subject = 0;  // 0: all
    int max_subjects = 1;       // of VMC
};

// `on_pose` gets one sender per subject, to ports that follow each other.
template <typename OnPose>
absl::Status run(const Options& options, const OnPose& on_pose) {
    const std::stop_token stop = client::stop_on_signals();
    const auto connection = options.connection.open();
    if (!connection.ok()) return connection.status();
    std::vector<UdpSender> senders;
    for (int n = 0; n < options.max_subjects; ++n) {
        auto sender = UdpSender::open(options.to, n);
        if (!sender.ok()) return sender.status();
        senders.push_back(*std::move(sender));
    }
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(options.max_rate_hz);
    client::StreamOptions stream;
    stream.reconnect = true;
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox-bridge: {}; reconnecting\n", std::string(why.message()));
    };
    stream.stop = stop;
    fmt::print("forwarding poses of {} to {}\n", options.connection.server, options.to);
    std::fflush(stdout);
    const absl::Status ended = client::Client(*connection)
                                   .stream_poses(
                                       request,
                                       [&](v1::StreamPosesResponse message) {
                                           client::keep_subject(message, options.subject);
                                           on_pose(message, senders);
                                           return true;
                                       },
                                       stream);
    std::uint64_t sent = 0, dropped = 0;
    for (const UdpSender& sender : senders) sent += sender.sent(), dropped += sender.dropped();
    fmt::print("{} datagrams sent, {} dropped\n", sent, dropped);
    return absl::IsCancelled(ended) ? absl::OkStatus() : ended;
}

// The protocol has one avatar per port.
absl::Status run_vmc(const Options& options) {
    std::int64_t first_ns = 0;
    Avatars avatars(options.max_subjects);
    return run(options, [&](const v1::StreamPosesResponse& message, std::vector<UdpSender>& senders) {
        const std::int64_t now_ns = message.header().capture_time_ns();
        if (first_ns == 0 || now_ns < first_ns) first_ns = now_ns;
        const double time_s = 1e-9 * static_cast<double>(now_ns - first_ns);
        std::vector<std::uint32_t> ids;
        for (const v1::SubjectPose& subject : message.subjects()) ids.push_back(subject.subject_id());
        const std::vector<std::uint32_t> shown = avatars.update(ids, now_ns);
        for (std::size_t n = 0; n < senders.size(); ++n) {
            const v1::Pose* pose = nullptr;
            std::string name;
            for (const v1::SubjectPose& subject : message.subjects()) {
                if (subject.subject_id() != shown[n]) continue;
                if (subject.has_pose()) pose = &subject.pose();
                name = subject.name();
            }
            for (const std::string& datagram : vmc_datagrams(pose, shown[n], time_s, name))
                senders[n].send(datagram);
        }
    });
}

client::PoseColumns columns_of(const std::string& content) {
    if (content == "joints") return client::PoseColumns::kJoints;
    return content == "coordinates" ? client::PoseColumns::kCoordinates : client::PoseColumns::kAngles;
}

absl::Status run_csv(const Options& options) {
    const client::PoseColumns columns = columns_of(options.content);
    const std::string header = client::pose_csv_header(columns);
    std::optional<std::int64_t> first_ns;
    std::int64_t header_ns = 0;
    return run(options, [&](const v1::StreamPosesResponse& message, std::vector<UdpSender>& senders) {
        UdpSender& sender = senders.front();
        const std::int64_t now_ns = message.header().capture_time_ns();
        const bool first = !first_ns || now_ns < header_ns;  // or a replay went back
        if (first) first_ns = now_ns;
        if (first || now_ns - header_ns >= kHeaderInterval_ns) {
            header_ns = now_ns;
            sender.send(header);
        }
        for (const std::string& line : client::pose_csv_lines(columns, message, *first_ns)) sender.send(line);
    });
}

}  // namespace

int main(int argc, char** argv) {
    gpr_set_log_function([](gpr_log_func_args*) {});  // errors come back as statuses; one line each is enough
    Options options;
    CLI::App app("Forward a daemon's poses over UDP until stopped.", "kinevox-bridge");
    client::add_connection_options(app, options.connection);
    app.require_subcommand(1);
    app.set_version_flag("--version", std::string("kinevox-bridge ") + KINEVOX_VERSION);
    const auto add = [&](const char* name, const char* help, const std::string& to) {
        CLI::App* command = app.add_subcommand(name, help);
        command->add_option("--to", options.to, fmt::format("Destination HOST:PORT (default: {})", to));
        command->add_option("--max-rate", options.max_rate_hz, "Maximum poses per second (0: all)")
            ->check(CLI::Range(0.0, 1000.0))
            ->capture_default_str();
        command->add_option("--subject", options.subject, "Id of the only subject to forward")
            ->check(CLI::PositiveNumber);
        return command;
    };
    const std::string vmc_to = fmt::format("127.0.0.1:{}", kVmcPort), csv_to = "127.0.0.1:50780";
    CLI::App* vmc = add("vmc", "Virtual Motion Capture protocol (OSC), for game engines and avatars", vmc_to);
    vmc->add_option("--max-subjects", options.max_subjects,
                    "Number of avatars; each is sent to a port of its own, from the port of --to upwards")
        ->check(CLI::Range(1, 16))
        ->capture_default_str();
    CLI::App* csv = add("csv", "One CSV line per datagram; the header every two seconds", csv_to);
    csv->add_option("--content", options.content, "angles (deg), joints (m) or coordinates (deg, m)")
        ->check(CLI::IsMember({"angles", "joints", "coordinates"}))
        ->capture_default_str();
    return tool_main(app, argc, argv, [&] {
        if (options.to.empty()) options.to = vmc->parsed() ? vmc_to : csv_to;
        return vmc->parsed() ? run_vmc(options) : run_csv(options);
    });
}
