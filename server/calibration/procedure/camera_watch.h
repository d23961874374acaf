// Checks in the background whether each camera still has the pose it had when the capture began.
//
// Threads: observe() the pose thread's, everything else any. The callback comes from the watch's own thread
// and must not call back into this class.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/camera.h"
#include "kernels/types.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

struct SceneShift {
    double rotation_deg = 0;  // of the camera since the first image
    double shift_px = 0;      // at the image centre; for a roll, half way to the border
    // Fraction of the image difference that the rotation explains, 0..1; all over the image, not in one part.
    double explained = 0;
};

// Measures whether one camera has rotated, from the static scene in an earlier image. Not thread safe.
class StaticScene {
  public:
    explicit StaticScene(const Camera& camera);
    ~StaticScene();
    StaticScene(StaticScene&&) noexcept;
    StaticScene& operator=(StaticScene&&) noexcept;

    // `ignored`: px, the subject; not compared. Later images are compared with the first ones. Empty if too
    // little of the scene is visible. About 3 ms.
    std::optional<SceneShift> measure(const Image& image, const kernels::Rect& ignored);

  private:
    struct Levels;
    Camera camera_;
    std::unique_ptr<Levels> first_;
};

struct CameraWatchOptions {
    double interval_s = 0.5;     // between checked frame sets
    double suspect_deg = 0.25;   // rotation that makes a camera suspect; half a degree must be found
    double restored_deg = 0.12;  // rotation below which it is restored
    double explained = 0.35;     // fraction of the image difference that the rotation must explain: else the
                                 // light or the subject has changed
    int confirmations = 2;       // consecutive checks
};

struct WatchedCamera {
    std::optional<double> shift_px;  // displacement of the static scene in the image; empty: not known yet
    bool suspect = false;
    std::string reason;  // one line with the remedy; empty unless suspect
};

// State of one camera over the checks.
class CameraMotionState {
  public:
    enum class Change { kNone, kMoved, kRestored };
    Change add(const std::optional<SceneShift>& shift, const std::string& camera,
               const CameraWatchOptions& options);
    const WatchedCamera& camera() const { return camera_; }

  private:
    WatchedCamera camera_;
    int moved_in_a_row_ = 0, restored_in_a_row_ = 0;
};

class CameraWatch {
  public:
    using OnEvent = std::function<void(const Event&)>;

    CameraWatch(std::vector<Camera> cameras, const CameraWatchOptions& options, OnEvent on_event);
    ~CameraWatch();
    CameraWatch(const CameraWatch&) = delete;
    CameraWatch& operator=(const CameraWatch&) = delete;

    // After each frame set; keeps the images of some of them, copies nothing and never blocks. If time goes
    // backwards the capture was restarted, and so is the watch.
    void observe(const FrameResult& result);
    // Takes the current poses as reference: a calibration was applied. The same cameras, in the same order.
    void reset(std::vector<Camera> cameras);
    // In the order of the cameras.
    std::vector<WatchedCamera> cameras() const;
    // Before the daemon ends.
    void close();

  private:
    struct Sample {
        std::uint64_t sequence = 0;
        std::int64_t time_ns = 0;
        bool restart = false;
        std::vector<Image> images;
        std::vector<kernels::Rect> ignored;  // the subject, per camera
        std::vector<Camera> cameras;         // on a restart
    };
    void watch_loop();
    void process(const Sample& sample);

    const CameraWatchOptions options_;
    const OnEvent on_event_;

    std::optional<std::int64_t> last_ns_;  // observe() only
    std::vector<StaticScene> scenes_;      // worker only, with their cameras' names
    std::vector<std::string> names_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable changed_;
    std::vector<Camera> cameras_;
    std::optional<Sample> next_;
    bool busy_ = false, restart_ = true, closed_ = false;
    std::vector<CameraMotionState> verdicts_;

    std::thread worker_;
};

}  // namespace kinevox
