#include "client/lib/pose_csv.h"

#include <fmt/format.h>

#include "common/joint_angles.h"
#include "common/skeleton.h"

namespace kinevox::client {

std::string pose_csv_head(PosePart part) {
    std::string head = "frame,time_s";
    if (part == PosePart::kAngles)
        for (const std::string_view name : kJointAngleNames) head += fmt::format(",{}_deg", name);
    else
        for (const std::string_view name : kJointNames) head += fmt::format(",{0}_x,{0}_y,{0}_z", name);
    return head;
}

std::string pose_csv_line(PosePart part, const v1::StreamPosesResponse& message, std::int64_t first_time_ns) {
    const v1::StreamHeader& header = message.header();
    std::string line = fmt::format("{},{:.6f}", header.sequence(),
                                   static_cast<double>(header.capture_time_ns() - first_time_ns) * 1e-9);
    const v1::Pose& pose = message.pose();
    if (part == PosePart::kAngles) {
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

}  // namespace kinevox::client
