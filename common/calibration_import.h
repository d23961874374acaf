// Calibrations of other programs, read from their text. Errors as in calibration_file.h.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

#include "common/camera.h"

namespace kinevox {

inline constexpr double kMaxImagePx = 32768;  // maximum side of an image in a calibration file

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
