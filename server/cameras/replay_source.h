// A recorded session as a source that can be paused, stepped, sought in, slowed down and looped while it
// runs.
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
    kEnded,  // paused behind the last frame set; play() begins anew
};

struct ReplayPosition {
    ReplayState state = ReplayState::kPlaying;
    std::int64_t frame = -1;  // handed out last, from 0; -1: none yet
    std::int64_t frames = 0;  // of the recording
    double position_s = 0;    // of that frame, from the recording's begin
    double fps = 0;           // nominal
    double speed = 1;         // asked for
    bool loop = false;
    std::uint64_t jumps = 0;  // frame sets handed out that did not follow the one before
};

struct ReplayOptions {
    bool paused = false;  // hands out the first frame set and waits
    bool loop = false;
    double speed = 1;
    int frames_ahead = 0;  // pictures decoded ahead per camera; 0: as many as fit into 64 MB, 2 to 16
};

// A frame set's capture time is the recording's own and goes back with it; its sequence always rises. Where
// the pipeline or the decoders are too slow for the speed, frame sets are left out as those of a live camera
// are, which shows as a gap in the sequence, and where that does not help the replay runs slower. It never
// ends by itself: behind the last frame set next() waits.
class ReplaySource : public FrameSource {
  public:
    static constexpr double kSlowest = 0.01, kFastest = 100;

    // Errors as open_session_source()'s; InvalidArgument also for options out of range. A video whose
    // container does not tell its length is read through once.
    static absl::StatusOr<std::shared_ptr<ReplaySource>> open(const std::filesystem::path& session_file,
                                                              const ReplayOptions& options = {});

    // Any thread; none waits for a picture.
    virtual void play() = 0;
    virtual void pause() = 0;
    // Pauses, and shows the frame set so many further on (negative: back), at most the last or the first.
    virtual void step(std::int64_t frames) = 0;
    // Goes on from there, playing or paused as before. OutOfRange where there is no such frame.
    virtual absl::Status seek(std::int64_t frame) = 0;
    // OutOfRange beyond the limits above.
    virtual absl::Status set_speed(double speed) = 0;
    virtual void set_loop(bool loop) = 0;
    // The frame whose time is nearest to this one; none of the recording's where the time is not.
    virtual std::int64_t frame_at(double position_s) const = 0;
    virtual ReplayPosition position() const = 0;
};

}  // namespace kinevox
