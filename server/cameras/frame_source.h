// Where frame sets come from. The pipeline knows this interface only; session files, the virtual studio and
// real cameras stand behind it.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/cameras/camera_link.h"

namespace kinevox {

// An owned picture: 8 bits a channel, rows without padding, B G R or grey. Shared, since previews, recorder
// and pipeline may all hold one; never changed after it was published.
struct Picture {
    int width = 0, height = 0, channels = 0;
    std::shared_ptr<const std::uint8_t[]>
        data;  // height * width * channels bytes; null: this camera has no picture

    bool empty() const { return data == nullptr; }
};

// The pictures of one instant, in the order of FrameSource::cameras(). A camera that delivered nothing has an
// empty Picture.
struct FrameSet {
    std::uint64_t sequence = 0;  // counts from 0 at the source; gaps are frame sets lost before the pipeline
    std::int64_t capture_time_ns = 0;  // steady clock, or the recording's own time from 0
    std::vector<Picture> pictures;
    // When each picture was taken, in the order and the clock of the above (of no meaning where there is no
    // picture); empty where the source knows one time only.
    std::vector<std::int64_t> picture_times_ns;
    std::optional<std::int64_t> recorded_frame;  // of a replayed recording: its number there, from 0
    bool after_jump = false;  // does not follow the one before in time: nothing learned from that one counts
    double decode_ms = 0;     // waiting for and decoding the pictures; 0: the caller of next() fills it in.
                              // The pipeline passes it on as StageTimes::decode_ms
};

// next() is called by one thread; stop() by any, once or often.
class FrameSource {
  public:
    virtual ~FrameSource() = default;

    virtual const std::vector<Camera>& cameras() const = 0;
    virtual double fps() const = 0;                // nominal frame sets a second
    virtual std::int64_t frame_count() const = 0;  // -1 where it does not end

    // Pictures of the empty scene, per camera in the order of cameras(); empty where the source has none
    // (then an operator lets the daemon learn the background from live frames).
    virtual absl::StatusOr<std::vector<std::vector<Picture>>> background() = 0;

    // Waits for the next frame set. OutOfRange: the recording is over. Cancelled: stop() was called. Anything
    // else is an error that names camera and file.
    virtual absl::StatusOr<FrameSet> next() = 0;
    virtual void stop() = 0;

    // Of live cameras, in the order of cameras(); empty for other sources. Any thread.
    virtual std::vector<CameraLink> camera_links() const { return {}; }
    // To be set before the first next(). Comes from threads of the source and must not wait.
    virtual void set_on_camera_event(OnCameraEvent) {}
};

enum class Pacing {
    kAsFastAsPossible,
    kRealTime,  // a frame set is handed out when its time has come; late ones are skipped and show as gaps
};

}  // namespace kinevox
