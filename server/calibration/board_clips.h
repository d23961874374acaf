// Videos or folders of pictures, one a camera, and the board found in them.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "server/calibration/board_detector.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct CameraClip {
    std::string camera;
    std::filesystem::path file;        // a video, a picture or a folder of pictures
    std::filesystem::path background;  // of the empty scene; empty where none is known
    int width = 0, height = 0;         // px
    std::int64_t first = 0;  // of its pictures that counts as its first: cameras may begin one by one
};

inline constexpr const char* kBoardHelp =
    "checkerboard:4x7:60 (inner corners, mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] (squares, square "
    "mm, "
    "marker mm) or aprilgrid:6x6:88:26.4 (tags, tag mm, gap mm)";

// Whether a verb was given a session instead of clips.
bool is_session(const std::vector<std::string>& arguments);

// "cam_0=board/cam_0.mp4"; a name without '=' is a file named as its camera, or, alone and ending in .toml, a
// session, whose cameras' videos and backgrounds are taken. Opens each to learn its size. InvalidArgument and
// NotFound name the argument.
absl::StatusOr<std::vector<CameraClip>> open_clips(const std::vector<std::string>& arguments);

// Which pictures of each clip are looked at.
struct ClipPictures {
    int first = 0;
    int every = 1;  // from the first on
    int most = -1;  // so many; -1: to the clip's end
};

// Cameras side by side: sightings[camera][picture], frame numbers are first + every * picture. Cancelled by
// `progress`.
absl::StatusOr<std::vector<std::vector<BoardSighting>>> find_boards(const std::vector<CameraClip>& clips,
                                                                    const BoardSpec& board,
                                                                    const ClipPictures& which,
                                                                    const SolveProgress& progress);

// Hands those pictures of each clip to what `start` made for its camera.
absl::Status read_side_by_side(const std::vector<CameraClip>& clips, const ClipPictures& which,
                               const std::string& what, const SolveProgress& progress,
                               const std::function<absl::StatusOr<std::function<void(const Picture&)>>(
                                   std::size_t camera, const Camera& size)>& start);

// The same for any search: `start` makes one for each camera (`size` has its name and picture's size) and is
// called, as what it returns, on a thread of that camera.
template <class Sighting>
using Search = std::function<Sighting(const Picture&)>;
template <class Sighting>
absl::StatusOr<std::vector<std::vector<Sighting>>> for_pictures(
    const std::vector<CameraClip>& clips, const ClipPictures& which, const std::string& what,
    const SolveProgress& progress,
    const std::function<absl::StatusOr<Search<Sighting>>(const CameraClip&, const Camera& size)>& start) {
    std::vector<std::vector<Sighting>> out(clips.size());
    const absl::Status status = read_side_by_side(
        clips, which, what, progress,
        [&](std::size_t c, const Camera& size) -> absl::StatusOr<std::function<void(const Picture&)>> {
            auto search = start(clips[c], size);
            if (!search.ok()) return search.status();
            return [&seen = out[c], search = *std::move(search)](const Picture& picture) {
                seen.push_back(search(picture));
            };
        });
    if (!status.ok()) return status;
    return out;
}

}  // namespace kinevox
