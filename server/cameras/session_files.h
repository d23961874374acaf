// An opened session: maps images to frame sets and frame sets to times. Used by all readers of sessions.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/recording_files.h"
#include "common/session_file.h"
#include "server/cameras/image_reader.h"

namespace kinevox {

// Times of a session's frame sets, ns from the first.
class FrameTimes {
  public:
    // Evenly spaced, or as recorded, including gaps.
    explicit FrameTimes(double fps, std::vector<RecordedTime> recorded = {})
        : fps_(fps), recorded_(std::move(recorded)) {}

    // Of `frame` >= 0; after the last recorded frame the times continue as in a loop.
    std::int64_t of(std::int64_t frame) const;
    // The frame nearest to a time (s); negative or after the last frame if the time is.
    std::int64_t nearest(double seconds) const;

  private:
    double fps_;
    std::vector<RecordedTime> recorded_;
};

struct SessionFiles {
    Session session;
    std::vector<Camera> cameras;                       // in the session's order
    std::vector<std::unique_ptr<ImageReader>> images;  // per camera; image n belongs to frame set n
    FrameTimes times{1};
};

// Opens all files and checks that each is readable, matches its camera's calibration in size and has as many
// images as the others. With offset_s, the frame sets cover the time range common to all cameras; of a
// truncated recording the complete ones remain. Errors name camera, file, numbers and remedy: NotFound,
// InvalidArgument, DataLoss.
absl::StatusOr<SessionFiles> open_session_files(Session session);
// The same; also repairs a truncated recording.
absl::StatusOr<SessionFiles> open_session_files(const std::filesystem::path& session_file);

// Memory of the images of one frame set; never 0.
std::size_t frame_set_bytes(const std::vector<Camera>& cameras);

// Exact number of frame sets; reads a file once if its container does not store the count. InvalidArgument if
// the cameras differ.
absl::StatusOr<std::int64_t> count_frame_sets(const SessionFiles& files);

// Background images per camera; empty if the session has none.
absl::StatusOr<std::vector<std::vector<Image>>> read_backgrounds(const Session& session,
                                                                 const std::vector<Camera>& cameras);
// InvalidArgument names the first camera without background images; `session` is the session's name in the
// message.
absl::Status each_has_background(const std::vector<std::vector<Image>>& background,
                                 const std::vector<Camera>& cameras, const std::string& session);

// Reading and repair of recordings, which may be truncated if the recorder was killed.

// The times of the frame sets that are complete in every file. InvalidArgument, NotFound; DataLoss if there
// are none. Requires session.recording.
absl::StatusOr<std::vector<RecordedTime>> complete_frame_sets(const Session& session);

// DataLoss if a closed recording, or one that was repaired, has fewer complete frame sets than it states: one
// of its indices, videos or the table of times is damaged. Not a recording, or not closed: OK.
absl::Status check_intact(const std::filesystem::path& session_file);

// Repairs a truncated recording: cuts its files to the complete frame sets and updates its session.toml.
// False if there is nothing to do: closed, being written, or not a recording. Errors if the files cannot be
// changed; they remain readable.
absl::StatusOr<bool> repair_recording(const std::filesystem::path& session_file);

}  // namespace kinevox
