// Watches, behind the running capture, whether every camera still stands where it stood when the capture
// began.
//
// Threads: observe() the posing thread's, everything else any. The callback comes from a thread of its own
// and must not call back into this class.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "common/camera.h"
#include "server/calibration/still_scene.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

struct CameraWatchOptions {
    double interval_s = 0.5;     // between frame sets that are looked at
    double suspect_deg = 0.25;   // a camera turned by so much is suspect; half a degree is to be found
    double in_place_deg = 0.12;  // and by less it is in place again
    double explained =
        0.35;  // part of the pictures' difference that the turn must explain: else it is the light
    int confirmations = 2;  // looks in a row
};

struct WatchedCamera {
    std::optional<double> shift_px;  // by which its picture of the room is displaced; empty: not known yet
    bool suspect = false;
    std::string reason;  // one line with the remedy; empty unless suspect
};

// What the looks at one camera come to.
class CameraVerdict {
  public:
    enum class Change { kNone, kMoved, kInPlace };
    Change add(const std::optional<SceneShift>& shift, const std::string& camera,
               const CameraWatchOptions& options);
    const WatchedCamera& camera() const { return camera_; }

  private:
    WatchedCamera camera_;
    int moved_in_a_row_ = 0, in_place_in_a_row_ = 0;
};

class CameraWatch {
  public:
    using OnEvent = std::function<void(const Event&)>;

    CameraWatch(std::vector<Camera> cameras, const CameraWatchOptions& options, OnEvent on_event);
    ~CameraWatch();
    CameraWatch(const CameraWatch&) = delete;
    CameraWatch& operator=(const CameraWatch&) = delete;

    // After each frame set; takes hold of the pictures of some of them, copies nothing and never waits. Where
    // time goes backwards the capture began anew, and so does the watch.
    void observe(const FrameResult& result);
    // Whatever the cameras see next is how they are meant to stand: a calibration was applied. The same
    // cameras, in the same order.
    void begin_anew(std::vector<Camera> cameras);
    // In the order of the cameras.
    std::vector<WatchedCamera> cameras() const;
    // For the daemon's end.
    void close();

  private:
    struct Look {
        std::uint64_t sequence = 0;
        std::int64_t time_ns = 0;
        bool anew = false;
        std::vector<Picture> pictures;
        std::vector<kernels::Rect> ignored;  // the subject, per camera
        std::vector<Camera> cameras;         // where it begins anew
    };
    void watch_loop();
    void look_at(const Look& look);

    const CameraWatchOptions options_;
    const OnEvent on_event_;

    std::optional<std::int64_t> last_ns_;  // observe()'s own
    std::vector<StillScene> scenes_;       // the worker's own, and their cameras' names
    std::vector<std::string> names_;

    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable changed_;
    std::vector<Camera> cameras_;
    std::optional<Look> next_;
    bool busy_ = false, anew_ = true, closed_ = false;
    std::vector<CameraVerdict> verdicts_;

    std::thread worker_;
};

}  // namespace kinevox
