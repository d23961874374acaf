// The recorder: encodes the capture's frame sets, holds the latest in a rolling buffer if configured, and
// writes recordings. It never blocks the capture: frame sets that do not fit into its queue are dropped and
// counted.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/pose/body_shape.h"
#include "server/recording/background_clip.h"
#include "server/recording/image_encoder.h"
#include "server/recording/recording_list.h"

namespace kinevox {

struct RecorderOptions {
    std::filesystem::path folder;  // of all recordings
    VideoCodec codec = VideoCodec::kUtVideo;
    bool save_poses = true, save_volumes = true;
    bool several_subjects = false;  // are followed: each has a body and volumes of its own
    double max_buffer_s = 0;        // length of the rolling buffer; 0: none
    std::size_t max_buffer_bytes = std::size_t{1} << 30;
    std::size_t max_queue_bytes = std::size_t{256}
                                  << 20;  // not yet written; beyond it frame sets are dropped
    std::uint64_t min_free_bytes = std::uint64_t{512} << 20;  // on the disk, below which a recording ends
};

// The capture, queried when a recording starts.
struct RecordedCapture {
    std::vector<Camera> cameras;
    double fps = 0;
    std::string calibration_id, certificate_json;
    std::filesystem::path calibration_file = {};  // from which the cameras were read; empty: none
};

enum class RecorderState { kIdle, kWaiting, kRecording, kFinishing };

struct RecorderStatus {
    RecorderState state = RecorderState::kIdle;
    std::optional<RecordingInfo> current;  // being written
    std::optional<RecordingInfo> latest;   // the last one that ended
    std::uint64_t free_bytes = 0;
    std::size_t queued_bytes = 0;
    // Of the rolling buffer.
    double buffered_s = 0;
    std::size_t buffered_bytes = 0;
    bool buffer_limited_by_memory = false;        // max_buffer_bytes, not max_buffer_s, limits it
    std::uint64_t buffer_dropped_frame_sets = 0;  // not buffered, since the capture's start
};

// offer() by one thread, observe() by one, the others by any.
class Recorder {
  public:
    // `capture` and `publish_event` are called on any thread and must not block. An error if the rolling
    // buffer's codec does not support the cameras' images.
    static absl::StatusOr<std::unique_ptr<Recorder>> create(const RecorderOptions& options,
                                                            std::function<RecordedCapture()> capture,
                                                            std::function<void(Event)> publish_event);
    virtual ~Recorder() = default;

    // Each frame set of the source. A few microseconds.
    virtual void offer(const FrameSet& frame_set) = 0;
    // Each result, and the bodies it was measured with. A few microseconds.
    virtual void observe(const FrameResult& result, const BodyOf& body_of) = 0;
    // The background images, whenever the background was learned.
    virtual void background_learned(BackgroundImages images) = 0;
    // No more frame sets: the current recording is finished in the background, the rolling buffer is emptied.
    virtual void capture_ended() = 0;

    // These block on files. `name` empty: date and time. InvalidArgument, AlreadyExists,
    // FailedPrecondition, ResourceExhausted, Unavailable.
    virtual absl::StatusOr<std::string> start(const std::string& name, std::optional<VideoCodec> codec) = 0;
    virtual absl::StatusOr<RecordingInfo> stop() = 0;
    // Saves the latest `duration_s` of the rolling buffer (0: all of it) as a recording, and continues it if
    // asked to.
    virtual absl::StatusOr<RecordingInfo> save_buffer(const std::string& name, double duration_s,
                                                      bool continue_recording) = 0;

    virtual RecorderStatus status() const = 0;
    virtual const RecorderOptions& options() const = 0;
    // Finishes the current recording; nothing starts afterwards.
    virtual void close() = 0;
};

}  // namespace kinevox
