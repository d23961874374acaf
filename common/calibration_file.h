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

// The layouts that are read, see below. Kalibr's has no world: its first camera is the origin.
std::string calibration_opencv_yaml(const std::vector<Camera>& cameras);
std::string calibration_kalibr_yaml(const std::vector<Camera>& cameras);

// Empty if Kalibr's format can hold these cameras, else one sentence.
std::string kalibr_problem(const std::vector<Camera>& cameras);

// Written atomically.
absl::Status write_calibration_toml(const std::vector<Camera>& cameras, const std::filesystem::path& file);

inline constexpr double kMaxImagePx = 32768;  // maximum side of an image in a calibration file

// Calibrations of other programs, read from their text; errors as above.

// Qualisys Track Manager's exported calibration (XML). Lengths there are in mm and pixels in 1/64 px; the
// position is the camera's centre in the world, r11 to r33 (row, column) turn world axes to the camera's,
// which are x right, y up, z backward. Distortion coefficients are OpenCV's k1 k2 p1 p2 k3 as they stand.
absl::StatusOr<std::vector<Camera>> parse_calibration_qualisys(const std::string& text,
                                                               const std::string& name_for_errors);

// OpenCV's YAML. There is no common layout for several cameras, so this one is read:
//
//   %YAML:1.0
//   ---
//   cam_01:
//      image_width: 640
//      image_height: 480
//      camera_matrix: !!opencv-matrix {rows: 3, cols: 3, dt: d, data: [fx, 0, cx, 0, fy, cy, 0, 0, 1]}
//      distortion_coefficients: !!opencv-matrix {...}    4 or 5: k1 k2 p1 p2 [k3]
//      rotation: !!opencv-matrix {...}                   3 x 3, or a Rodrigues vector of 3; world to camera
//      translation: !!opencv-matrix {...}                3, metres; world to camera
//
// OpenCV's calibration sample writes one camera at the top level with the same four names, without
// extrinsics; such a file is one camera, named as the file, at the world's origin unless rotation and
// translation are given.
absl::StatusOr<std::vector<Camera>> parse_calibration_opencv(const std::string& text,
                                                             const std::string& name_for_errors);

// Kalibr's camchain YAML: cam0, cam1, ... with camera_model pinhole, distortion_model radtan or none,
// intrinsics [fx, fy, cx, cy], distortion_coeffs [k1, k2, p1, p2], resolution [width, height] and, from the
// second on, T_cn_cnm1, which takes points from the camera before to this one. The first camera is the
// world's origin.
absl::StatusOr<std::vector<Camera>> parse_calibration_kalibr(const std::string& text,
                                                             const std::string& name_for_errors);

}  // namespace kinevox
