// Streamed poses as lines of text, with the columns of angles.csv, joints.csv and coordinates.csv.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "kinevox/v1/stream_service.pb.h"

namespace kinevox::client {

enum class PoseColumns { kAngles, kJoints, kCoordinates };

// frame,time_s,subject,sequence and the columns, whose names end in their units; joints are metres in the
// world.
std::string pose_csv_header(PoseColumns columns);
// One line per subject; one with an empty subject where none is tracked. `frame` is the recording's in a
// replay, else the sequence; time_s counts from `first_time_ns` (UTC). Cells of withheld values are empty.
std::vector<std::string> pose_csv_lines(PoseColumns columns, const v1::StreamPosesResponse& message,
                                        std::int64_t first_time_ns);

// The frame of a message: the recording's in a replay, else the sequence.
std::int64_t frame_of(const v1::StreamHeader& header);

}  // namespace kinevox::client
