#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "client/cli/line_stream.h"
#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "client/lib/pose_csv.h"

namespace kinevox::cli {
namespace {

using client::PoseColumns;

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

nlohmann::ordered_json subject_json(PoseColumns columns, const v1::SubjectPose& subject) {
    nlohmann::ordered_json out{{"subject_id", subject.subject_id()}};
    if (!subject.name().empty()) out["name"] = subject.name();
    out["pose_found"] = subject.has_pose();
    if (!subject.has_pose()) return out;
    const v1::Pose& pose = subject.pose();
    if (columns == PoseColumns::kAngles) {
        out["angles"] = by_name(pose.angles());
        out["ratios"] = to_json(pose.ratios());
    } else if (columns == PoseColumns::kJoints) {
        out["joints"] = by_name(pose.joints());
        out["segment_orientations"] = by_name(pose.segment_orientations());
    } else {
        out["coordinates"] = by_name(pose.coordinates());
        out["translations"] = by_name(pose.translations());
    }
    out["contour_residual_rms_m"] = number_or_null(pose.contour_residual_rms_m());
    return out;
}

std::string json_line(PoseColumns columns, const v1::StreamPosesResponse& message) {
    nlohmann::ordered_json out = to_json(message.header());
    nlohmann::ordered_json& subjects = out["subjects"] = nlohmann::ordered_json::array();
    for (const v1::SubjectPose& subject : message.subjects())
        subjects.push_back(subject_json(columns, subject));
    return out.dump();
}

absl::Status run_poses(const GlobalOptions& global, PoseColumns columns, const LineStreamOptions& options) {
    absl::StatusOr<LineWriter> writer = LineWriter::open(options.out, options.overwrite);
    if (!writer.ok()) return writer.status();
    const bool csv = options.format == "csv" && !global.json;
    if (csv) writer->print(client::pose_csv_header(columns));
    v1::StreamPosesRequest request;
    request.set_max_rate_hz(options.max_rate_hz);
    request.set_delivery(options.delivery());
    const client::StreamOptions stream = options.stream();  // blocks signals, so before gRPC starts threads
    int count = 0;
    std::optional<std::int64_t> first_time_ns;
    const auto print = [&](v1::StreamPosesResponse message) {
        client::keep_subject(message, options.subject);
        if (!csv) return writer->print(json_line(columns, message));
        bool read = true;
        for (const std::string& line : client::pose_csv_lines(columns, message, *first_time_ns))
            read = read && writer->print(line);
        return read;
    };
    const absl::Status status = client::Client(global.client_options())
                                    .stream_poses(
                                        request,
                                        [&](const v1::StreamPosesResponse& message) {
                                            if (!first_time_ns)
                                                first_time_ns = message.header().capture_time_ns();
                                            return print(message) && ++count != options.frames;
                                        },
                                        stream);
    if (const absl::Status written = writer->close(); !written.ok()) return written;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_pose_streams(CLI::App& stream, GlobalOptions& global, Run& run) {
    const auto add = [&](PoseColumns columns, const char* name, const char* help) {
        const auto options = std::make_shared<LineStreamOptions>();
        CLI::App* command = stream.add_subcommand(name, help);
        add_line_stream_options(*command, *options, {}, "Output file (default: standard output)");
        command->callback([&global, &run, options, columns] {
            run = [&global, options, columns] { return run_poses(global, columns, *options); };
        });
    };
    add(PoseColumns::kAngles, "angles",
        "Geometric joint angles (deg), one line per result; CSV columns as in angles.csv");
    add(PoseColumns::kJoints, "joints",
        "Joint positions in the world (m), one line per result; CSV columns as in joints.csv");
    add(PoseColumns::kCoordinates, "coordinates",
        "Model coordinates (deg, m), one line per result; CSV columns as in coordinates.csv");
}

}  // namespace kinevox::cli
