// session.toml: which videos, backgrounds and calibration make one capture.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct SessionCamera {
    std::string name;                  // a section of the calibration file
    std::filesystem::path video;       // a video or a folder of pictures; absolute after reading
    std::filesystem::path background;  // a picture, a clip or a folder; empty if there is none
};

struct Session {
    std::string name;
    double fps = 0;                     // frame sets a second, > 0
    std::filesystem::path calibration;  // absolute after reading
    std::filesystem::path truth;        // folder of ground truth, empty if there is none
    std::vector<SessionCamera> cameras;
};

// Paths are resolved against the file's folder; a folder truth/ beside the file is found without a key. An
// unknown key, a wrong type, no camera, two cameras of one name: InvalidArgument; a missing file: NotFound;
// each one line with file and line number. Does not open the videos.
absl::StatusOr<Session> read_session(const std::filesystem::path& file);
absl::StatusOr<Session> parse_session_toml(const std::string& text, const std::filesystem::path& folder,
                                           const std::string& name_for_errors, bool check_files_exist);

// The calibrated cameras of a session, in its order. NotFound names both files where the calibration lacks
// one.
absl::StatusOr<std::vector<Camera>> read_session_cameras(const Session& session);

// Paths below the file's folder are written relative to it. Written aside and renamed.
absl::Status write_session(const Session& session, const std::filesystem::path& file);

}  // namespace kinevox
