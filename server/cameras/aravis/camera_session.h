// One connected camera: opened, configured, streaming. Hides Aravis.
#pragma once

#include <absl/status/statusor.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "common/live_camera_config.h"
#include "server/cameras/aravis/live_source.h"
#include "server/cameras/frame_set_assembler.h"
#include "server/cameras/image_pool.h"

namespace kinevox {

class CameraSession {
  public:
    // `width`, `height`: image size, from the calibration. Errors are one line with the camera's name, the
    // cause and the remedy: NotFound, PermissionDenied (another program controls it), InvalidArgument for a
    // setting, Unavailable otherwise. The camera streams when this returns.
    static absl::StatusOr<std::unique_ptr<CameraSession>> open(const FoundCamera& found,
                                                               const LiveSourceConfig& config,
                                                               const LiveCameraConfig& camera, int width,
                                                               int height);
    // Releases the camera. Takes some seconds if it no longer answers.
    ~CameraSession();
    CameraSession(const CameraSession&) = delete;
    CameraSession& operator=(const CameraSession&) = delete;

    enum class Outcome { kNothing, kImage };
    // Waits for the next image, complete or not, and fills in all but ArrivedImage::camera. The image's
    // memory comes from `pool` (3 * width * height bytes).
    Outcome next(std::chrono::milliseconds timeout, ImagePool& pool, ArrivedImage& out);

    bool control_lost() const;  // another program has taken control
    bool answers();             // on its control channel; takes some seconds if it does not
    void trigger();             // by command; any thread
    // Checks whether the camera is synchronised by PTP by now; decides how its timestamps are interpreted.
    void update_clock();
    // Fills in the packet counts, buffer_underrun_count and packet_size_bytes of this connection.
    void fill(CameraConnection& link) const;

  private:
    struct State;
    explicit CameraSession(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

}  // namespace kinevox
