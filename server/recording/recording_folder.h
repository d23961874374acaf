// One recording on disk while it is being written; docs/recording.md shows its files.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "common/camera.h"
#include "common/session_file.h"
#include "server/pose/body_shape.h"
#include "server/recording/encoding_lanes.h"
#include "server/recording/recording_list.h"

namespace kinevox {

// What is known of a recording before its first frame set.
struct RecordingPlan {
    std::filesystem::path folder;  // of this recording; made by create()
    double fps = 0;
    VideoCodec codec = VideoCodec::kUtVideo;
    std::vector<Camera> cameras;
    std::vector<VideoFormat> formats;               // per camera
    std::vector<std::filesystem::path> background;  // per camera a video to be taken over, or empty
    std::string calibration_id;                     // that was in use; empty: the source's own
    std::filesystem::path calibration_file;         // that the cameras were read from, if they were
    std::string certificate_json;                   // of that calibration, where it has one
    std::optional<BodyShape> body;                  // of the subject
    bool poses = true, volumes = true;              // tables and file for them
};

// What the pipeline found in a recorded frame set.
struct RecordedResult {
    std::shared_ptr<const BodyPose> pose;  // null: none
    std::string volume;                    // encode_volume()'s; empty: none
};

// One thread at a time. Each append is whole or not there, and what the files hold is a session at any
// moment.
class RecordingFolder {
  public:
    // AlreadyExists where the folder is there; ResourceExhausted for a full disk; Unavailable.
    static absl::StatusOr<std::unique_ptr<RecordingFolder>> create(const RecordingPlan& plan);
    virtual ~RecordingFolder() = default;  // as if the process were killed

    // The first one must be a key. After an error the recording ends with the set before; close() it.
    virtual absl::Status append(const EncodedSet& set) = 0;
    // Of frame set `frame` (from 0, of those appended), rising; those left out get rows without values.
    virtual absl::Status append_result(std::uint64_t frame, const RecordedResult& result) = 0;
    // Where the plan had none, since it was learned later: per camera a video. Does nothing the second time.
    virtual absl::Status set_background(const std::vector<std::filesystem::path>& videos) = 0;
    // In use from the next result on.
    virtual absl::Status set_body(const BodyShape& body) = 0;
    // What the session says about itself when it is closed.
    struct Ending {
        std::uint64_t dropped = 0;  // frame sets
        std::string reason;         // empty: somebody asked for it
    };
    virtual absl::Status close(const Ending& ending) = 0;

    virtual const std::filesystem::path& path() const = 0;
    virtual const SessionRecording& about() const = 0;  // frames, lost and missing so far
    virtual RecordingInfo info() const = 0;
};

}  // namespace kinevox
