// Calibration files: Pose2Sim/aniposelib TOML, OpenCV YAML and Kalibr camchain YAML read and written,
// Qualisys .qca.txt read.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <vector>

#include "common/camera.h"

namespace kinevox {

// Reads by ending: .toml, .qca.txt/.qca/.xml (Qualisys; mm, 1/64 px, y up z back axes), .yml/.yaml (OpenCV,
// or Kalibr by its key camera_model). Errors name the file, the line or key, the value and the remedy:
// NotFound, InvalidArgument. Every number is finite, sizes and focal lengths are positive, names unique,
// rotations proper.
absl::StatusOr<std::vector<Camera>> read_calibration(const std::filesystem::path& file);

// The same from text, `name_for_errors` standing for the file; TOML only. What the fuzzer calls.
absl::StatusOr<std::vector<Camera>> parse_calibration_toml(const std::string& text,
                                                           const std::string& name_for_errors);

std::string calibration_toml(const std::vector<Camera>& cameras);

// The layouts that calibration_import.h reads. Kalibr's has no world: its first camera is the origin.
std::string calibration_opencv_yaml(const std::vector<Camera>& cameras);
std::string calibration_kalibr_yaml(const std::vector<Camera>& cameras);

// Empty if Kalibr's format can hold these cameras, else one sentence.
std::string kalibr_problem(const std::vector<Camera>& cameras);

// Written atomically.
absl::Status write_calibration_toml(const std::vector<Camera>& cameras, const std::filesystem::path& file);

}  // namespace kinevox
