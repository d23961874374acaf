#include "client/lib/pose_csv.h"

#include <fmt/format.h>

#include "common/body_table.h"

namespace kinevox::client {
namespace {

// The cells of named estimates in their fixed order; empty where one is withheld or absent.
template <typename Estimates, typename Names, typename Cell>
void append_cells(std::string& line, const Estimates& estimates, const Names& names, const char* empty,
                  const Cell& cell) {
    for (int i = 0; i < static_cast<int>(names.size()); ++i) {
        const std::string text = i < estimates.size() ? cell(estimates.Get(i)) : "";
        line += text.empty() ? empty : "," + text;
    }
}

std::string joint_cells(const v1::JointEstimate& joint) {
    if (!joint.has_position_in_world()) return "";
    const v1::Vec3& at = joint.position_in_world();
    return fmt::format("{:.5f},{:.5f},{:.5f}", at.x(), at.y(), at.z());
}

void append_coordinates(std::string& line, const v1::Pose& pose) {
    int translation = 0, rotation = 0;
    for (int d = 0; d < kBodyDofCount; ++d) {
        line += ',';
        if (is_position(d)) {
            if (const int i = translation++;
                i < pose.translations_size() && pose.translations(i).has_value_m())
                line += fmt::format("{:.5f}", pose.translations(i).value_m());
        } else if (const int i = rotation++;
                   i < pose.coordinates_size() && pose.coordinates(i).has_value_deg()) {
            line += fmt::format("{:.4f}", pose.coordinates(i).value_deg());
        }
    }
}

void append_pose(std::string& line, PoseColumns columns, const v1::Pose& pose) {
    const auto degrees = [](const v1::AngleEstimate& angle) {
        return angle.has_value_deg() ? fmt::format("{:.3f}", angle.value_deg()) : std::string();
    };
    if (columns == PoseColumns::kAngles)
        append_cells(line, pose.angles(), kJointAngleNames, ",", degrees);
    else if (columns == PoseColumns::kJoints)
        append_cells(line, pose.joints(), kJointNames, ",,,", joint_cells);
    else
        append_coordinates(line, pose);
}

}  // namespace

std::int64_t frame_of(const v1::StreamHeader& header) {
    return header.has_recorded_frame() ? header.recorded_frame()
                                       : static_cast<std::int64_t>(header.sequence());
}

std::string pose_csv_header(PoseColumns columns) {
    std::string header = "frame,time_s,subject,sequence";
    if (columns == PoseColumns::kAngles)
        for (const std::string_view name : kJointAngleNames) header += fmt::format(",{}_deg", name);
    else if (columns == PoseColumns::kJoints)
        for (const std::string_view name : kJointNames) header += fmt::format(",{0}_x,{0}_y,{0}_z", name);
    else
        for (int d = 0; d < kBodyDofCount; ++d)
            header += fmt::format(",{}_{}", kBodyDofs[static_cast<std::size_t>(d)].name,
                                  is_position(d) ? "m" : "deg");
    return header;
}

std::vector<std::string> pose_csv_lines(PoseColumns columns, const v1::StreamPosesResponse& message,
                                        std::int64_t first_time_ns) {
    const v1::StreamHeader& header = message.header();
    const double time_s = static_cast<double>(header.capture_time_ns() - first_time_ns) * 1e-9;
    std::vector<std::string> lines;
    const auto add = [&](const std::string& subject, const v1::Pose& pose) {
        std::string line =
            fmt::format("{},{:.6f},{},{}", frame_of(header), time_s, subject, header.sequence());
        append_pose(line, columns, pose);
        lines.push_back(std::move(line));
    };
    for (const v1::SubjectPose& subject : message.subjects())
        add(std::to_string(subject.subject_id()), subject.pose());
    if (lines.empty()) add("", {});
    return lines;
}

}  // namespace kinevox::client
