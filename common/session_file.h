// session.toml: which videos, backgrounds and calibration make one capture.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct SessionCamera {
    std::string name;                  // a section of the calibration file
    std::filesystem::path video;       // a video or a folder of pictures; absolute after reading
    std::filesystem::path background;  // a picture, a clip or a folder; empty if there is none
    // When its first picture was taken, s, on the time axis that all cameras of the session share: picture n
    // was taken at offset_s + n / fps. Absent: 0. With it the videos may be of different length; see
    // session_offsets.h.
    std::optional<double> offset_s = std::nullopt;
};

// What the recorder says of a session that it wrote; docs/recording.md.
struct SessionRecording {
    std::filesystem::path
        times;  // frames.csv, common/recording_files.h; the videos have their indices beside them
    std::filesystem::path
        poses;  // folder of tables as `kinevox process` writes them; empty if there are none
    std::filesystem::path volumes;  // empty if there are none
    std::string codec;              // of the videos
    std::string calibration_id;     // that was in use; empty: the source's own
    bool closed = false;            // false: being written, or cut off
    bool recovered = false;         // was cut off
    std::string end_reason;         // why it ended; empty: somebody asked for that
    std::int64_t started_utc_ns = 0;
    // Known once it is closed.
    std::uint64_t frames = 0;            // frame sets
    std::uint64_t dropped = 0;           // that came, but not in time to be recorded
    std::uint64_t lost = 0;              // before the recorder
    std::uint64_t missing_pictures = 0;  // of single cameras
};

struct Session {
    std::string name;
    double fps = 0;                     // frame sets a second, > 0
    std::filesystem::path calibration;  // absolute after reading
    std::filesystem::path truth;        // folder of ground truth, empty if there is none
    std::vector<SessionCamera> cameras;
    std::optional<SessionRecording> recording = std::nullopt;  // where the recorder wrote it
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
