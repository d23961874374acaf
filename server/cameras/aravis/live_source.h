// Cameras on the network or on USB as a source of frame sets.
#pragma once

#include <absl/status/statusor.h>

#include <memory>

#include "common/live_camera_config.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Reads the calibration, which defines order, names and sizes: NotFound or InvalidArgument name the file and
// the camera it lacks. Accesses no camera: from the first next() on, a thread per camera finds, configures
// and reads it, and reconnects after a disconnection. An absent camera is an event and a state, not an error.
absl::StatusOr<std::unique_ptr<FrameSource>> open_live_source(const LiveSourceConfig& config);

}  // namespace kinevox
