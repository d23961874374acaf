// The thread of one live camera: finds it, opens it, reads it, detects that it disconnected, and reconnects.
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/live_camera_config.h"
#include "server/cameras/aravis/live_source.h"
#include "server/cameras/camera_connection.h"
#include "server/cameras/frame_set_assembler.h"

namespace kinevox {

// State shared by the cameras' threads and the source. Each of them keeps it alive, so that a thread blocked
// in an unresponsive camera can be detached.
struct LiveCameras {
    LiveCameras(const LiveSourceConfig& config, std::vector<Camera> cameras);

    const LiveSourceConfig config;
    const std::vector<Camera> cameras;  // in the order of config.cameras

    // Moves completed frame sets from the assembler to `ready`; under the mutex. When the queue is full, the
    // oldest are dropped, which shows as a gap in the sequence.
    void collect();
    void publish_event(CameraEvent::Kind kind, std::size_t camera, std::string message);

    std::mutex event_mutex;  // held during the callback, so that none follows stop()
    OnCameraEvent on_event;

    std::mutex mutex;  // guards all below
    std::condition_variable changed;
    bool stopped = false;
    FrameSetAssembler assembler;
    std::deque<FrameSet> ready;           // at most config.max_queued_frame_sets
    std::vector<CameraConnection> links;  // device, error message and packet counts
    std::size_t running = 0;              // threads
};

// Caches the list of discovered cameras and repeats the discovery when it is too old. Any thread; concurrent
// requests share one discovery.
class CameraFinder {
  public:
    using List = std::shared_ptr<const std::vector<FoundCamera>>;
    List latest(std::chrono::milliseconds max_age);

  private:
    std::mutex mutex_;
    List list_;
    std::chrono::steady_clock::time_point at_;
};

// Runs until the cameras are stopped.
void run_camera(std::shared_ptr<LiveCameras> cameras, std::shared_ptr<CameraFinder> finder,
                std::size_t index);

}  // namespace kinevox
