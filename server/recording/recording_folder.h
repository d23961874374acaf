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

// Properties of a recording that are fixed before its first frame set.
struct RecordingPlan {
    std::filesystem::path folder;  // of this recording; created by create()
    double fps = 0;
    VideoCodec codec = VideoCodec::kUtVideo;
    std::vector<Camera> cameras;
    std::vector<VideoFormat> formats;               // per camera
    std::vector<std::filesystem::path> background;  // per camera a video to link or copy, or empty
    std::string calibration_id;                     // the active one; empty: the source's own
    std::filesystem::path calibration_file;         // from which the cameras were read; empty: none
    std::string certificate_json;                   // of that calibration; empty: none
    std::optional<BodyShape> body;                  // of the subject
    bool save_poses = true, save_volumes = true;
    bool several_subjects = false;  // may be in one frame set: each has a body and volumes of its own
};

// What the pipeline found of one subject in a recorded frame set.
struct RecordedSubject {
    std::uint32_t id = 0;
    std::string name;                       // at this time; empty: none
    std::shared_ptr<const BodyPose> pose;   // null: none
    std::shared_ptr<const BodyShape> body;  // of this subject among several; null: that of set_body()
    std::string volume;                     // encode_volume()'s; empty: none
};

// The pipeline's result of a recorded frame set.
struct RecordedResult {
    std::vector<RecordedSubject> subjects;  // those tracked, in the order of their ids
};

// One thread at a time. Each append is atomic: the files are a valid session at any time.
class RecordingFolder {
  public:
    // AlreadyExists if the folder exists; ResourceExhausted for a full disk; Unavailable.
    static absl::StatusOr<std::unique_ptr<RecordingFolder>> create(const RecordingPlan& plan);
    virtual ~RecordingFolder() = default;  // as if the process were killed

    // The first one must be a key frame. After an error the recording ends with the set before; close() it.
    virtual absl::Status append(const EncodedSet& set) = 0;
    // Of frame set `frame` (from 0, of those appended), increasing; skipped ones get rows without values.
    virtual absl::Status append_result(std::uint64_t frame, const RecordedResult& result) = 0;
    // If the plan had none because it was learned later: per camera a video. The second call does nothing.
    virtual absl::Status set_background(const std::vector<std::filesystem::path>& videos) = 0;
    // Active from the next result on.
    virtual absl::Status set_body(const BodyShape& body) = 0;
    struct Ending {
        std::uint64_t dropped = 0;  // frame sets
        std::string reason;         // empty: stopped on request
    };
    virtual absl::Status close(const Ending& ending) = 0;

    virtual const std::filesystem::path& path() const = 0;
    virtual const SessionRecording& about() const = 0;  // counts so far
    virtual RecordingInfo info() const = 0;
};

}  // namespace kinevox
