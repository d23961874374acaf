// Cameras on the network or on USB as a source of frame sets.
#pragma once

#include <absl/status/statusor.h>

#include <memory>

#include "common/live_camera_config.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Reads the calibration, which fixes the order, names and sizes: NotFound or InvalidArgument name the file
// and the camera that it lacks. Touches no camera: each has a thread that finds, sets and reads it from the
// first next() on, and finds it again whenever it went away. A camera that is not there is an event and a
// state, no error.
absl::StatusOr<std::unique_ptr<FrameSource>> open_live_source(const LiveCamerasConfig& config);

}  // namespace kinevox
