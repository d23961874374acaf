// The interface of all sources of frame sets: session files, the virtual studio and live cameras.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/cameras/camera_connection.h"

namespace kinevox {

// An owned image: 8 bits per channel, rows without padding, B G R or grey. Shared by previews, recorder and
// pipeline; immutable once published.
struct Image {
    int width = 0, height = 0, channels = 0;
    std::shared_ptr<const std::uint8_t[]> data;  // height * width * channels bytes; null: no image

    bool empty() const { return data == nullptr; }
};

// The images of one instant, in the order of FrameSource::cameras(); empty for a camera that delivered none.
struct FrameSet {
    std::uint64_t sequence =
        0;  // from 0, assigned by the source; gaps are frame sets lost before the pipeline
    std::int64_t capture_time_ns = 0;  // steady clock, or session time from 0
    std::vector<Image> images;
    // Capture time of each image, on the same clock (undefined where there is no image); empty if the source
    // has only one time.
    std::vector<std::int64_t> image_times_ns;
    std::optional<std::int64_t> recorded_frame;  // frame number in the replayed recording, from 0
    // Does not follow the previous one in time: state from earlier frame sets is reset.
    bool after_discontinuity = false;
    // Time to wait for and decode the images; 0: the caller of next() fills it in. Becomes
    // StageTimes::decode_ms.
    double decode_ms = 0;
};

// next() is called by one thread; stop() by any, once or often.
class FrameSource {
  public:
    virtual ~FrameSource() = default;

    virtual const std::vector<Camera>& cameras() const = 0;
    virtual double fps() const = 0;                // nominal frame sets per second
    virtual std::int64_t frame_count() const = 0;  // -1: endless

    // Background images, per camera in the order of cameras(); empty if the source has none (then the daemon
    // learns the background from live frames).
    virtual absl::StatusOr<std::vector<std::vector<Image>>> background() = 0;

    // Waits for the next frame set. OutOfRange: end of the recording. Cancelled: stop() was called. Other
    // errors name camera and file.
    virtual absl::StatusOr<FrameSet> next() = 0;
    virtual void stop() = 0;

    // Connections of live cameras, in the order of cameras(); empty for other sources. Any thread.
    virtual std::vector<CameraConnection> camera_connections() const { return {}; }
    // Set before the first next(). Called from threads of the source; must not block.
    virtual void set_on_camera_event(OnCameraEvent) {}
};

enum class Pacing {
    kAsFastAsPossible,
    kRealTime,  // a frame set is handed out when it is due; late ones are skipped, which shows as gaps
};

}  // namespace kinevox
