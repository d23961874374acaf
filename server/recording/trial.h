// A processed trial as `kinevox process` leaves it in a folder, read once for every export.
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

#include "common/joint_angles.h"
#include "common/skeleton.h"
#include "server/pose/body_model.h"

namespace kinevox {

// World as everywhere: metres, z up; radians. A withheld value is NaN; a joint's three are withheld together.
struct Trial {
    std::string name;  // of the folder
    std::filesystem::path folder;
    double rate_hz = 0;
    // Counted at the rate, without gaps; those of the session where it lost no frame set, else what was lost
    // is counted too and has no values.
    std::vector<std::int64_t> frames;
    std::vector<std::int64_t> pictures;  // the session's frame; -1: it was lost
    std::vector<double> time_s;          // even, within half a frame
    double max_beside_s = 0;             // how far it lay beside, where the source's beat was not even
    std::vector<std::array<Vec3, kJointNames.size()>> joints;  // in the order of kJointNames
    // Empty where the folder has no such file.
    std::vector<std::array<double, kJointAngleNames.size()>> angles_rad;  // in the order of kJointAngleNames
    std::vector<BodyCoordinates> coordinates;                             // m, rad; in the order of kBodyDofs
    std::optional<BodyShape> body;

    std::size_t size() const { return frames.size(); }
};

// Reads joints.csv, which must be there, and angles.csv, coordinates.csv and body.toml where they are.
// Strict: other columns, other frames than joints.csv, a cell that is no number: one line with file and line.
// A trial of fewer than two frames, or in which no joint of any frame was measured, is an error too. `fps`:
// the session's rate, 0 if not known; it is asked for only where the times of a source that lagged do not
// tell.
absl::StatusOr<Trial> read_trial(const std::filesystem::path& folder, double fps = 0);

// FailedPrecondition names the file that is missing and the format that is made of it.
absl::Status needs_coordinates_and_body(const Trial& trial, std::string_view format);

// Both ends included; OutOfRange where the trial has fewer than two frames of them.
absl::StatusOr<Trial> part_of_trial(const Trial& trial, std::int64_t first_frame, std::int64_t last_frame);

// The whole trial turned about the world's vertical through the origin, anticlockwise from above.
void turn_trial(Trial& trial, double angle_rad);

}  // namespace kinevox
