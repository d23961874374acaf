// The thread of one live camera: finds it, opens it, reads it, notices when it is gone, and begins again.
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
#include "server/cameras/aravis/discovery.h"
#include "server/cameras/camera_link.h"
#include "server/cameras/frame_set_assembler.h"

namespace kinevox {

// What the cameras' threads and the source share. Kept alive by each of them, so that a thread that is stuck
// in a dead camera may be left behind.
struct LiveCameras {
    LiveCameras(const LiveCamerasConfig& config, std::vector<Camera> cameras);

    const LiveCamerasConfig config;
    const std::vector<Camera> cameras;  // in the order of config.cameras

    // Moves what the assembler has ready; under the mutex. Whoever fetches late gets the newest sets, and
    // sees the others as a gap in the numbers.
    void collect();
    void tell(CameraEvent::Kind kind, std::size_t camera, std::string message);

    std::mutex event_mutex;  // held while an event is told, so that none comes after stop
    OnCameraEvent on_event;

    std::mutex mutex;  // guards all below
    std::condition_variable changed;
    bool stopped = false;
    FrameSetAssembler assembler;
    std::deque<FrameSet> ready;     // at most config.queue
    std::vector<CameraLink> links;  // device, problem and what the connections told
    std::size_t running = 0;        // threads
};

// The cameras that were found last; asks again when that is too long ago. Any thread; several that ask at
// once share one answer.
class CameraFinder {
  public:
    using List = std::shared_ptr<const std::vector<FoundCamera>>;
    List newest(std::chrono::milliseconds at_most_old);

  private:
    std::mutex mutex_;
    List list_;
    std::chrono::steady_clock::time_point at_;
};

// Runs until the cameras are stopped.
void run_camera(std::shared_ptr<LiveCameras> cameras, std::shared_ptr<CameraFinder> finder,
                std::size_t index);

}  // namespace kinevox
