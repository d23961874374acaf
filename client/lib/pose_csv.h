// Streamed poses as lines of text, with the columns of angles.csv and joints.csv.
#pragma once

#include <cstdint>
#include <string>

#include "kinevox/v1/stream_service.pb.h"

namespace kinevox::client {

enum class PosePart { kAngles, kJoints };

// frame,time_s and the columns; degrees, or metres in the world.
std::string pose_csv_head(PosePart part);
// `frame` is the sequence, time_s counts from `first_time_ns` (UTC). What is withheld leaves its cells empty.
std::string pose_csv_line(PosePart part, const v1::StreamPosesResponse& message, std::int64_t first_time_ns);

}  // namespace kinevox::client
