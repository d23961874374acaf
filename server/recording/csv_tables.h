// Tables as CSV: their strict reader, and the pose tables that `kinevox process` and the recorder write.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/body_pose.h"
#include "common/recording_files.h"

namespace kinevox {

// A table as text.
struct Table {
    std::string file_name;
    std::string text;  // header and rows
};

// Quoted where a comma, a quote or a line break demands it.
std::string csv_cell(std::string_view text);

struct CsvTable {
    std::string file;  // for messages
    std::size_t columns = 0;
    std::vector<double> cells;       // row after row; NaN where empty
    std::vector<std::size_t> lines;  // per row its line in the file, from 1
    std::size_t rows() const { return columns ? cells.size() / columns : 0; }
    double at(std::size_t row, std::size_t column) const { return cells[row * columns + column]; }
};

// Reads a table that `kinevox process` wrote: a header of exactly `columns`, then rows of numbers or empty
// cells. InvalidArgument names file, line and column.
absl::StatusOr<CsvTable> read_csv_table(const std::filesystem::path& file,
                                        std::span<const std::string> columns);

// One per frame and subject present; one without a subject for a frame in which none is.
struct PoseRow {
    std::uint64_t frame = 0;
    double time_s = 0;
    std::uint32_t subject_id = 0;          // from 1; 0: no subject, the cell is empty
    std::shared_ptr<const BodyPose> pose;  // null: all cells are empty
};

// Each table begins with frame,time_s,subject:
//   joints.csv       JOINT_x, _y, _z: metres, world
//   angles.csv       ANGLE_deg of kJointAngleNames
//   coordinates.csv  NAME_m or NAME_deg of kBodyDofs
//   uncertainty.csv  standard deviations (JOINT_std_m per axis, ANGLE_std_deg, NAME_std_m or _deg of the
//   coordinates)
//                    and the number of cameras that determine a joint or angle (JOINT_camera_count), also of
//                    withheld values
//   withheld.csv     name,reason: one row per withheld joint and angle, or one named "pose" for all of them
// Withheld cells of the first three are empty; a coordinate is withheld with the joint at its segment's far
// end. Nothing is withheld from a frame without a subject.
std::vector<Table> pose_tables(const std::vector<PoseRow>& rows);

// The same row by row: in the order of kPoseTableNames, with line breaks. Of withheld.csv a row has any
// number of lines.
using PoseLines = std::array<std::string, kPoseTableNames.size()>;
PoseLines pose_table_headers();
PoseLines pose_table_rows(const PoseRow& row);

// The columns of a pose table in order, for readers.
std::vector<std::string> joint_columns();
std::vector<std::string> angle_columns();
std::vector<std::string> coordinate_columns();

}  // namespace kinevox
