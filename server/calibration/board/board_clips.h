// Videos or image folders, one per camera, and the board detected in them.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "server/calibration/board/board_detector.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct CameraClip {
    std::string camera;
    std::filesystem::path file;        // video, image or folder of images
    std::filesystem::path background;  // images of the empty scene; empty if unknown
    int width = 0, height = 0;         // px
    std::int64_t first = 0;  // index of the first image that is used: recordings may start at different times
};

inline constexpr const char* kBoardHelp =
    "checkerboard:4x7:60 (inner corners, mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] (squares, square "
    "mm, "
    "marker mm) or aprilgrid:6x6:88:26.4 (tags, tag mm, gap mm)";

// True if the only argument is a session.toml.
bool is_session(const std::vector<std::string>& arguments);

// Parses "cam_0=board/cam_0.mp4"; without '=' the camera is named after the file. A single argument that ends
// in .toml is a session: its videos and backgrounds are used. Opens each clip to read its size.
// InvalidArgument and NotFound name the argument.
absl::StatusOr<std::vector<CameraClip>> open_clips(const std::vector<std::string>& arguments);

// Selects images of each clip.
struct ClipImages {
    int first = 0;
    int stride = 1;      // from the first one
    int max_count = -1;  // number of images; -1: to the end
};

// Cameras in parallel: detections[camera][image]; frame numbers are first + stride * image. Cancelled by
// `progress`.
absl::StatusOr<std::vector<std::vector<BoardDetection>>> detect_boards(const std::vector<CameraClip>& clips,
                                                                       const BoardSpec& board,
                                                                       const ClipImages& which,
                                                                       const SolveProgress& progress);

// Passes the selected images of each clip to the function that `start` returns for its camera.
absl::Status read_side_by_side(const std::vector<CameraClip>& clips, const ClipImages& which,
                               const std::string& what, const SolveProgress& progress,
                               const std::function<absl::StatusOr<std::function<void(const Image&)>>(
                                   std::size_t camera, const Camera& size)>& start);

// The same for any detector. `start` creates one per camera (`size` has its name and image size); the
// returned function is called on one thread per camera.
template <class Detection>
using Search = std::function<Detection(const Image&)>;
template <class Detection>
absl::StatusOr<std::vector<std::vector<Detection>>> for_images(
    const std::vector<CameraClip>& clips, const ClipImages& which, const std::string& what,
    const SolveProgress& progress,
    const std::function<absl::StatusOr<Search<Detection>>(const CameraClip&, const Camera& size)>& start) {
    std::vector<std::vector<Detection>> out(clips.size());
    const absl::Status status = read_side_by_side(
        clips, which, what, progress,
        [&](std::size_t c, const Camera& size) -> absl::StatusOr<std::function<void(const Image&)>> {
            auto search = start(clips[c], size);
            if (!search.ok()) return search.status();
            return [&seen = out[c], search = *std::move(search)](const Image& image) {
                seen.push_back(search(image));
            };
        });
    if (!status.ok()) return status;
    return out;
}

}  // namespace kinevox
