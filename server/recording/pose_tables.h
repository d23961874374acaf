// What `kinevox process` and the recorder write of the poses; design: "Contract of the command line".
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "common/recording_files.h"
#include "server/recording/table.h"

namespace kinevox {

struct PoseRow {
    std::uint64_t frame = 0;
    double time_s = 0;
    std::shared_ptr<const BodyPose> pose;  // null: all its cells are empty
};

//   joints.csv       frame,time_s, then x,y,z of each joint: metres, world
//   angles.csv       frame,time_s, then each angle: degrees
//   coordinates.csv  frame,time_s, then each of kBodyDofs: NAME_m or NAME_deg. A coordinate that turns a
//   withheld joint
//                    is withheld with it
//   uncertainty.csv  frame,time_s, then the standard deviations (JOINT_std_m of one axis, ANGLE_std_deg, and
//   those of the
//                    coordinates) and for joints and angles the number of cameras that support them; of
//                    withheld values too
//   withheld.csv     frame,time_s,name,reason: a row for each withheld joint and angle, or one named "pose"
//   for all
// What is withheld leaves its cells empty in the first three.
std::vector<Table> pose_tables(const std::vector<PoseRow>& rows);

// The same row by row.
using PoseLines =
    std::array<std::string, kPoseTableNames.size()>;  // in the order of kPoseTableNames, with line breaks
PoseLines pose_table_headers();
PoseLines pose_table_rows(
    const PoseRow& row);  // of withheld.csv as many lines as there are values withheld, or none

}  // namespace kinevox
