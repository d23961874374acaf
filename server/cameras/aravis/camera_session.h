// One camera while it is connected: opened, set as configured, streaming. Aravis stays behind this.
#pragma once

#include <absl/status/statusor.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/live_camera_config.h"
#include "server/cameras/aravis/discovery.h"
#include "server/cameras/frame_set_assembler.h"
#include "server/cameras/picture_pool.h"

namespace kinevox {

class CameraSession {
  public:
    // `width`, `height`: of its pictures, from the calibration. Errors are one line with the camera's name,
    // what it refused, and the remedy: NotFound, PermissionDenied (somebody else controls it),
    // InvalidArgument for a setting, Unavailable for all else. Streams when this returns.
    static absl::StatusOr<std::unique_ptr<CameraSession>> open(const FoundCamera& found,
                                                               const LiveCamerasConfig& config,
                                                               const LiveCameraConfig& camera, int width,
                                                               int height);
    // Gives the camera back. Takes some seconds where it answers no more.
    ~CameraSession();
    CameraSession(const CameraSession&) = delete;
    CameraSession& operator=(const CameraSession&) = delete;

    enum class Outcome { kNothing, kPicture };
    // Waits for the next picture, complete or not; all of it but the camera's place is filled in. The
    // picture's memory is the pool's (`pool` of 3 * width * height bytes).
    Outcome next(std::chrono::milliseconds longest, PicturePool& pool, ArrivedPicture& out);

    bool control_lost() const;  // it says that somebody else has it
    bool answers();             // on its control channel; takes some seconds where it does not
    void trigger();             // by command; any thread
    // Looks whether the camera has found the others' clock by now, and takes its timestamps accordingly.
    void look_at_clock();
    // packets_..., resend_requests, underruns, packet_bytes of this connection.
    void fill(CameraLink& link) const;

  private:
    struct State;
    explicit CameraSession(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
