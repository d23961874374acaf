#include "client/cli/stream_poses.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/json.h"
#include "client/lib/pose_csv.h"

namespace kinevox::cli {
namespace {

using client::PosePart;

// By name, which reads better in scripts than a list.
template <typename Estimates>
nlohmann::ordered_json by_name(const Estimates& estimates) {
    nlohmann::ordered_json out = nlohmann::ordered_json::object();
    for (const auto& estimate : estimates) {
        nlohmann::ordered_json entry = to_json(estimate);
        entry.erase("name");
        out[estimate.name()] = std::move(entry);
    }
    return out;
}

std::string json_line(PosePart part, const v1::StreamPosesResponse& message) {
    nlohmann::ordered_json out = to_json(message.header());
    const char* key = part == PosePart::kAngles ? "angles" : "joints";
    out[key] = nullptr;
    if (!message.has_pose()) return out.dump();
    const v1::Pose& pose = message.pose();
    if (part == PosePart::kAngles) {
        out[key] = by_name(pose.angles());
        out["ratios"] = to_json(pose.ratios());
    } else {
        out[key] = by_name(pose.joints());
        out["segments"] = by_name(pose.segments());
    }
    out["contour_rms_m"] = pose.contour_rms_m();
    return out.dump();
}

absl::Status run_poses(const Common& common, PosePart part, const LineStreamOptions& options) {
    absl::StatusOr<LineWriter> writer = LineWriter::open(options.out);
    if (!writer.ok()) return writer.status();
    const bool csv = options.format == "csv" && !common.json;
    if (csv) writer->print(client::pose_csv_head(part));
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(options.rate_hz);
    request.set_delivery(options.delivery());
    const client::StreamOptions stream = options.stream();  // blocks signals, so before gRPC starts threads
    int count = 0;
    std::optional<std::int64_t> first_time_ns;
    const absl::Status status =
        client::Client(common.client_options())
            .stream_poses(
                request,
                [&](const v1::StreamPosesResponse& message) {
                    if (!first_time_ns) first_time_ns = message.header().capture_time_ns();
                    const bool read = writer->print(csv ? client::pose_csv_line(part, message, *first_time_ns)
                                                        : json_line(part, message));
                    return read && ++count != options.frames;
                },
                stream);
    if (const absl::Status written = writer->close(); !written.ok()) return written;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_pose_streams(CLI::App& stream, Common& common, Run& run) {
    const auto add = [&](PosePart part, const char* name, const char* help) {
        const auto options = std::make_shared<LineStreamOptions>();
        CLI::App* verb = stream.add_subcommand(name, help);
        add_common_options(*verb, common);
        add_line_stream_options(*verb, *options, {}, "File for the lines");
        verb->callback([&, options, part] {
            run = [&common, options, part] { return run_poses(common, part, *options); };
        });
    };
    add(PosePart::kAngles, "angles",
        "Joint angles in degrees: a line a result, csv with the columns of angles.csv");
    add(PosePart::kJoints, "joints",
        "Joint positions in metres: a line a result, csv with the columns of joints.csv");
}

}  // namespace kinevox::cli
