// The recorder: takes frame sets from the capture, encodes them, keeps the newest in memory if asked to, and
// writes recordings. Nothing here makes the capture wait: what cannot be taken at once is dropped and
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
#include "server/recording/background_clip.h"
#include "server/recording/picture_encoder.h"
#include "server/recording/recording_list.h"

namespace kinevox {

struct BodyShape;

struct RecorderOptions {
    std::filesystem::path folder;  // of all recordings
    VideoCodec codec = VideoCodec::kUtVideo;
    bool poses = true, volumes = true;
    double keep_last_s = 0;  // of the rolling buffer; 0: none
    std::size_t keep_last_bytes = std::size_t{1} << 30;
    std::size_t queue_bytes = std::size_t{256}
                              << 20;  // taken and not yet written; beyond it frame sets are dropped
    std::uint64_t min_free_bytes = std::uint64_t{512} << 20;  // on the disk, below which a recording ends
};

// Of the capture, asked for when a recording begins.
struct RecordedCapture {
    std::vector<Camera> cameras;
    double fps = 0;
    std::string calibration_id, certificate_json;
    std::filesystem::path calibration_file = {};  // that the cameras were read from; empty: none
};

enum class RecorderState { kIdle, kWaiting, kRecording, kFinishing };

struct RecorderStatus {
    RecorderState state = RecorderState::kIdle;
    std::optional<RecordingInfo> recording;  // being written
    std::optional<RecordingInfo> last;       // that ended last
    std::uint64_t free_bytes = 0;
    std::size_t queued_bytes = 0;
    double held_seconds = 0;  // by the rolling buffer
    std::size_t held_bytes = 0;
    bool held_shortened = false;     // by keep_last_bytes
    std::uint64_t held_dropped = 0;  // frame sets that did not get into it, since the capture's start
};

// offer() by one thread, observe() by one, the others by any.
class Recorder {
  public:
    // `capture` and `tell` are called on any thread and must not wait. An error where the rolling buffer's
    // codec cannot take the cameras' pictures.
    static absl::StatusOr<std::unique_ptr<Recorder>> create(const RecorderOptions& options,
                                                            std::function<RecordedCapture()> capture,
                                                            std::function<void(Event)> tell);
    virtual ~Recorder() = default;

    // Each frame set that the source delivers. A few microseconds.
    virtual void offer(const FrameSet& frame_set) = 0;
    // Each result, and the body that it was measured with (null: no poses). A few microseconds.
    virtual void observe(const FrameResult& result, const BodyShape* body) = 0;
    // The empty scene, whenever it was learned.
    virtual void learned(EmptyScene pictures) = 0;
    // No more frame sets: a recording under way is finished behind the caller, the rolling buffer is emptied.
    virtual void capture_ended() = 0;

    // Calls that wait for files. `name` empty: date and time. InvalidArgument, AlreadyExists,
    // FailedPrecondition, ResourceExhausted, Unavailable.
    virtual absl::StatusOr<std::string> start(const std::string& name, std::optional<VideoCodec> codec) = 0;
    virtual absl::StatusOr<RecordingInfo> stop() = 0;
    virtual absl::StatusOr<RecordingInfo> keep_last(const std::string& name, double seconds, bool go_on) = 0;

    virtual RecorderStatus status() const = 0;
    virtual const RecorderOptions& options() const = 0;
    // Finishes what is being recorded; nothing starts afterwards.
    virtual void close() = 0;
};

}  // namespace kinevox
