#include "client/cli/stream_poses.h"

#include <memory>
#include <optional>

#include <CLI/CLI.hpp>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "client/cli/json.h"
#include "common/joint_angles.h"
#include "common/skeleton.h"

namespace kinevox::cli {
namespace {

enum class Part { kAngles, kJoints };

// The columns of angles.csv and joints.csv.
std::string csv_head(Part part) {
    std::string head = "frame,time_s";
    if (part == Part::kAngles)
        for (const std::string_view name : kJointAngleNames) head += fmt::format(",{}_deg", name);
    else
        for (const std::string_view name : kJointNames) head += fmt::format(",{0}_x,{0}_y,{0}_z", name);
    return head;
}

// What is withheld leaves its cells empty.
std::string csv_line(Part part, const v1::StreamPosesResponse& message, std::int64_t first_time_ns) {
    const v1::StreamHeader& header = message.header();
    std::string line = fmt::format("{},{:.6f}", header.sequence(),
                                   static_cast<double>(header.capture_time_ns() - first_time_ns) * 1e-9);
    const v1::Pose& pose = message.pose();
    if (part == Part::kAngles) {
        for (int i = 0; i < static_cast<int>(kJointAngleNames.size()); ++i) {
            line += ',';
            if (i < pose.angles_size() && pose.angles(i).has_value_deg())
                line += fmt::format("{:.3f}", pose.angles(i).value_deg());
        }
        return line;
    }
    for (int i = 0; i < static_cast<int>(kJointNames.size()); ++i) {
        if (i < pose.joints_size() && pose.joints(i).has_position_in_world()) {
            const v1::Vec3& at = pose.joints(i).position_in_world();
            line += fmt::format(",{:.5f},{:.5f},{:.5f}", at.x(), at.y(), at.z());
        } else {
            line += ",,,";
        }
    }
    return line;
}

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

std::string json_line(Part part, const v1::StreamPosesResponse& message) {
    nlohmann::ordered_json out = to_json(message.header());
    const char* key = part == Part::kAngles ? "angles" : "joints";
    out[key] = nullptr;
    if (!message.has_pose()) return out.dump();
    const v1::Pose& pose = message.pose();
    if (part == Part::kAngles) {
        out[key] = by_name(pose.angles());
        out["ratios"] = to_json(pose.ratios());
    } else {
        out[key] = by_name(pose.joints());
        out["segments"] = by_name(pose.segments());
    }
    out["contour_rms_m"] = pose.contour_rms_m();
    return out.dump();
}

absl::Status run_poses(const Common& common, Part part, const LineStreamOptions& options) {
    absl::StatusOr<LineWriter> writer = LineWriter::open(options.out);
    if (!writer.ok()) return writer.status();
    const bool csv = options.format == "csv" && !common.json;
    if (csv) writer->print(csv_head(part));
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(options.rate_hz);
    request.set_delivery(options.delivery());
    const client::StreamOptions stream = options.stream();   // blocks signals, so before gRPC starts threads
    int count = 0;
    std::optional<std::int64_t> first_time_ns;
    const absl::Status status = client::Client(common.client_options())
        .stream_poses(request,
                      [&](const v1::StreamPosesResponse& message) {
                          if (!first_time_ns) first_time_ns = message.header().capture_time_ns();
                          const bool read = writer->print(csv ? csv_line(part, message, *first_time_ns)
                                                              : json_line(part, message));
                          return read && ++count != options.frames;
                      },
                      stream);
    if (const absl::Status written = writer->close(); !written.ok()) return written;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_pose_streams(CLI::App& stream, Common& common, Run& run) {
    const auto add = [&](Part part, const char* name, const char* help) {
        const auto options = std::make_shared<LineStreamOptions>();
        CLI::App* verb = stream.add_subcommand(name, help);
        add_common_options(*verb, common);
        add_line_stream_options(*verb, *options, {}, "File for the lines");
        verb->callback([&, options, part] { run = [&common, options, part] { return run_poses(common, part, *options); }; });
    };
    add(Part::kAngles, "angles", "Joint angles in degrees: a line a result, csv with the columns of angles.csv");
    add(Part::kJoints, "joints", "Joint positions in metres: a line a result, csv with the columns of joints.csv");
}

}  // namespace kinevox::cli
