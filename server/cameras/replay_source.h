// Replays a recorded session; supports pause, step, seek, speed and loop during playback.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>

#include "common/session_file.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

enum class ReplayState {
    kPlaying,
    kPaused,
    kEnded,  // paused after the last frame set; play() restarts
};

struct ReplayPosition {
    ReplayState state = ReplayState::kPlaying;
    std::int64_t frame = -1;  // last handed out, from 0; -1: none yet
    std::int64_t frame_count = 0;
    double position_s = 0;  // of that frame, from the start of the recording
    double nominal_fps = 0;
    double speed = 1;  // as requested
    bool loop = false;
    std::uint64_t discontinuity_count = 0;  // frame sets handed out that did not follow the previous one
};

struct ReplayOptions {
    bool paused = false;  // waits after the first frame set
    bool loop = false;
    double speed = 1;
    int frames_ahead = 0;  // images decoded ahead per camera; 0: as many as fit into 64 MB, 2 to 16
};

// The capture time of a frame set is session time and jumps back with seeks; the sequence always rises. If
// the pipeline or the decoders are too slow for the speed, frame sets are skipped as with live cameras, which
// shows as a gap in the sequence; if that does not suffice, the replay slows down. It is endless: after the
// last frame set next() waits.
class ReplaySource : public FrameSource {
  public:
    static constexpr double kMinSpeed = 0.01, kMaxSpeed = 100;

    // Errors as open_session_source(); InvalidArgument also for options out of range. A video whose container
    // does not store its length is read once.
    static absl::StatusOr<std::shared_ptr<ReplaySource>> open(const std::filesystem::path& session_file,
                                                              const ReplayOptions& options = {});

    // Any thread; non-blocking.
    virtual void play() = 0;
    virtual void pause() = 0;
    // Pauses and shows the frame set `frames` ahead (negative: back), clamped to the recording.
    virtual void step(std::int64_t frames) = 0;
    // Continues from there, playing or paused as before. OutOfRange if there is no such frame.
    virtual absl::Status seek(std::int64_t frame) = 0;
    // OutOfRange beyond the limits above.
    virtual absl::Status set_speed(double speed) = 0;
    virtual void set_loop(bool loop) = 0;
    // The frame nearest to this time; out of the recording's range if the time is.
    virtual std::int64_t frame_at(double position_s) const = 0;
    virtual ReplayPosition position() const = 0;
};

}  // namespace kinevox
