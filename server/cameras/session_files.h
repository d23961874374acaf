// A session's files, opened: which picture of which camera belongs to which frame set, and when that one was.
// In one place for all that read sessions.
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
#include "server/cameras/picture_reader.h"

namespace kinevox {

// When a session's frame sets were taken, ns from the first one.
class FrameTimes {
  public:
    // Evenly spaced; or as they were recorded, gaps included.
    explicit FrameTimes(double fps, std::vector<RecordedTime> recorded = {})
        : fps_(fps), recorded_(std::move(recorded)) {}

    // Of `frame` from 0; behind the last recorded one they begin anew, as in a loop.
    std::int64_t of(std::int64_t frame) const;
    // The frame that is nearest to a time, s; below 0 or beyond the last where the time is.
    std::int64_t nearest(double seconds) const;

  private:
    double fps_;
    std::vector<RecordedTime> recorded_;
};

struct SessionFiles {
    Session session;
    std::vector<Camera> cameras;                           // in the session's order
    std::vector<std::unique_ptr<PictureReader>> pictures;  // per camera; picture n belongs to frame set n
    FrameTimes times{1};
};

// Opens all files and checks what can be known before the first picture: that each is there and readable, has
// the size of its camera's calibration and as many pictures as the others. Where the session has offset_s,
// frame sets begin when all cameras have begun and end when the first has ended; of a recording that was cut
// off there are those that are whole. Errors name camera, file, numbers and remedy: NotFound,
// InvalidArgument, DataLoss.
absl::StatusOr<SessionFiles> open_session_files(Session session);
// The same, and closes a recording that was cut off.
absl::StatusOr<SessionFiles> open_session_files(const std::filesystem::path& session_file);

// Of one frame set's pictures in memory; never 0.
std::size_t frame_set_bytes(const std::vector<Camera>& cameras);

// How many frame sets there are, exactly; a file whose container does not say is read through once.
// InvalidArgument where the cameras differ in it.
absl::StatusOr<std::int64_t> count_frame_sets(const SessionFiles& files);

// Pictures of the empty scene, per camera; empty where the session has none.
absl::StatusOr<std::vector<std::vector<Picture>>> read_backgrounds(const Session& session,
                                                                   const std::vector<Camera>& cameras);
// InvalidArgument with the first camera that has none; `session` names it.
absl::Status each_has_background(const std::vector<std::vector<Picture>>& background,
                                 const std::vector<Camera>& cameras, const std::string& session);

}  // namespace kinevox
