// joints.csv and angles.csv; design: "Contract of the command line".
#pragma once

#include <memory>
#include <vector>

#include "common/body_pose.h"
#include "server/tools/process/tables.h"

namespace kinevox {

struct PoseRow {
    std::uint64_t frame = 0;
    double time_s = 0;
    std::shared_ptr<const BodyPose> pose;   // null: all its cells are empty
};

//   joints.csv  frame,time_s, then x,y,z of each joint: metres, world
//   angles.csv  frame,time_s, then each angle: degrees
// What is withheld leaves its cells empty.
std::vector<Table> pose_tables(const std::vector<PoseRow>& rows);

}  // namespace kinevox
