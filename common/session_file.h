// session.toml: the videos, backgrounds and calibration of one capture, and the offsets of its videos.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/camera.h"

namespace kinevox {

struct SessionCamera {
    std::string name;                  // a section of the calibration file
    std::filesystem::path video;       // a video or a folder of images; absolute after reading
    std::filesystem::path background;  // an image, a clip or a folder; empty: none
    // Time of its first image, s, on the time axis that all cameras of the session share: image n is taken at
    // offset_s + n / fps. Absent: 0. With it the videos may differ in length; see first_image_indices().
    std::optional<double> offset_s = std::nullopt;
};

// [recording]: what the recorder states about a session that it wrote; docs/recording.md.
struct SessionRecording {
    std::filesystem::path
        frame_times;              // frames.csv, common/recording_files.h; each video has its index next to it
    std::filesystem::path poses;  // folder of tables as `kinevox process` writes them; empty: none
    std::filesystem::path volumes;  // empty: none
    std::string codec;              // of the videos
    std::string calibration_id;     // the active one; empty: the source's own
    bool closed = false;            // false: being written, or interrupted
    bool recovered = false;         // was interrupted and repaired
    std::string end_reason;         // why it ended; empty: it was stopped on request
    std::int64_t start_time_utc_ns = 0;
    // Known once it is closed.
    std::uint64_t frame_sets = 0;          // recorded
    std::uint64_t dropped_frame_sets = 0;  // delivered, but too late to be recorded
    std::uint64_t lost_frame_sets = 0;     // before the recorder
    std::uint64_t missing_images = 0;      // of single cameras
};

struct Session {
    std::string name;
    double fps = 0;                     // frame sets per second, > 0
    std::filesystem::path calibration;  // absolute after reading
    std::filesystem::path truth;        // folder of ground truth, empty if there is none
    std::vector<SessionCamera> cameras;
    std::optional<SessionRecording> recording = std::nullopt;  // where the recorder wrote it
};

// Paths are resolved against the file's folder; a folder truth/ next to the file needs no key.
// InvalidArgument for an unknown or renamed key, a wrong type, no camera or two cameras of one name, NotFound
// for a missing file; each one line with file and line number. Does not open the videos.
absl::StatusOr<Session> read_session(const std::filesystem::path& file);
absl::StatusOr<Session> parse_session_toml(const std::string& text, const std::filesystem::path& folder,
                                           const std::string& name_for_errors, bool check_files_exist);

// The calibrated cameras of a session, in its order. NotFound names both files if the calibration lacks one.
absl::StatusOr<std::vector<Camera>> read_session_cameras(const Session& session);

// Paths below the file's folder are written relative to it. Atomic.
absl::Status write_session(const Session& session, const std::filesystem::path& file);

// Sessions whose videos were started one by one: their frame sets, and the offsets in session.toml.

// True if any camera has an offset_s: its videos may then start and end at different times.
bool has_offsets(const Session& session);

// Per camera the index of the image in the first frame set: the first at which all cameras have started.
// Frame set s holds image first + s of each camera. If the cameras' images alternate, those within the
// shortest time, which is less than a frame, are joined. All 0 without offsets.
std::vector<std::int64_t> first_image_indices(const Session& session);

// Number of frame sets if camera c has images[c] images, counted from first_image_indices(). InvalidArgument
// names the cameras if one starts after another has ended.
absl::StatusOr<std::int64_t> common_length(const Session& session, std::span<const std::int64_t> images);

// The text of a session.toml with one offset_s in each [[camera]], in the order of the file; everything else
// stays, including comments. InvalidArgument for inline tables, which are not supported here.
absl::StatusOr<std::string> with_offsets(const std::string& text, std::span<const double> offsets_s);

// Replaces the file by with_offsets() or, if that fails, by write_session(), which loses its comments.
// Atomic.
absl::Status write_offsets(const std::filesystem::path& session_file, std::span<const double> offsets_s);

}  // namespace kinevox
