#include "server/tools/process/pose_tables.h"

#include <iterator>
#include <numbers>

#include <fmt/format.h>

namespace kinevox {

std::vector<Table> pose_tables(const std::vector<PoseRow>& rows) {
    std::string joints = "frame,time_s", angles = joints;
    for (const std::string_view joint : kJointNames) joints += fmt::format(",{0}_x,{0}_y,{0}_z", joint);
    for (const std::string_view angle : kJointAngleNames) angles += fmt::format(",{}_deg", angle);
    for (const PoseRow& row : rows) {
        const std::string begin = fmt::format("\n{},{:.6f}", row.frame, row.time_s);
        joints += begin;
        angles += begin;
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            if (row.pose && row.pose->joints[j].measured()) {
                const Vec3 p = row.pose->joints[j].in_world;
                fmt::format_to(std::back_inserter(joints), ",{:.5f},{:.5f},{:.5f}", p.x, p.y, p.z);
            } else {
                joints += ",,,";
            }
        }
        for (std::size_t k = 0; k < kJointAngleNames.size(); ++k) {
            angles += ',';
            if (row.pose && row.pose->angles[k].measured())
                fmt::format_to(std::back_inserter(angles), "{:.3f}",
                               row.pose->angles[k].value_rad * 180 / std::numbers::pi);
        }
    }
    joints += '\n';
    angles += '\n';
    return {{"joints.csv", joints}, {"angles.csv", angles}};
}

}  // namespace kinevox
