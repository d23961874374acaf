// A processed trial: the pose tables of one subject in a folder that `kinevox process` or the recorder wrote.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/body_pose.h"
#include "common/body_table.h"
#include "server/pose/body_model.h"

namespace kinevox {

// World frame: metres, z up; radians. Withheld values are NaN; the three of a joint are withheld together.
struct Trial {
    std::string name;              // of the folder
    std::uint32_t subject_id = 0;  // 0: all rows are of the only one
    std::string subject_name;      // empty: none
    std::filesystem::path folder;
    double rate_hz = 0;
    // Consecutive numbers at the rate. Equal to session_frames if no frame set was lost; lost ones count and
    // have no values.
    std::vector<std::int64_t> frames;
    std::vector<std::int64_t> session_frames;  // -1: lost
    std::vector<double> time_s;                // evenly spaced, within half a frame
    double max_time_snap_s = 0;  // largest shift to the frame grid, if the source's timing was irregular
    std::vector<std::array<Vec3, kJointNames.size()>> joints;  // in the order of kJointNames
    // Empty if the folder has no such file.
    std::vector<std::array<double, kJointAngleNames.size()>> angles_rad;  // in the order of kJointAngleNames
    std::vector<BodyCoordinates> coordinates;                             // m, rad; in the order of kBodyDofs
    std::optional<BodyShape> body;

    std::size_t size() const { return frames.size(); }
};

// Reads joints.csv and, if present, angles.csv, coordinates.csv, the body and the subject's name.
// `subject_id` 0: the rows of all subjects, which must then be one at a time; FailedPrecondition names the
// ids if a frame has several. Other columns, other frames than joints.csv or a cell that is no number are
// errors with file and line; so are fewer than two frames and a trial without any measured joint. `fps`: the
// session's rate, 0 if not known; used only if the times of an irregular source are ambiguous.
absl::StatusOr<Trial> read_trial(const std::filesystem::path& folder, double fps = 0,
                                 std::uint32_t subject_id = 0);

// Whom the tables are about.
struct TrialSubjects {
    std::vector<std::uint32_t> ids;  // of those with a measured joint, ascending
    int max_at_once = 0;             // in one frame
};
absl::StatusOr<TrialSubjects> subjects_of_trial(const std::filesystem::path& folder);

// One for each of `subjects`, or one of all rows if they are one at a time. Errors as read_trial().
absl::StatusOr<std::vector<Trial>> read_trials(const std::filesystem::path& folder, double fps,
                                               const TrialSubjects& subjects);

// FailedPrecondition names the missing file and the format that needs it.
absl::Status needs_coordinates_and_body(const Trial& trial, std::string_view format);

// Both ends included; OutOfRange if the trial has fewer than two of these frames.
absl::StatusOr<Trial> slice_trial(const Trial& trial, std::int64_t first_frame, std::int64_t last_frame);

// Rotates the trial about the world's vertical through the origin, counter-clockwise from above.
void rotate_trial(Trial& trial, double yaw_rad);

}  // namespace kinevox
