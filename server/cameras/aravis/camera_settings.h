// A camera's features as the configuration wants them; only for the .cc files of this folder.
#pragma once

#include <absl/status/status.h>

#include "common/live_camera_config.h"
#include "server/cameras/aravis/aravis_handles.h"

namespace kinevox {

// Pixel format, region, exposure, gain, white balance, rate and trigger. InvalidArgument names the camera,
// the key, its value and what the camera said.
absl::Status apply_settings(ArvCamera* camera, const LiveCamerasConfig& config, const LiveCameraConfig& of,
                            int width, int height);

// Switches PTP on where the camera has it.
void enable_ptp(ArvCamera* camera);
// It keeps the others' clock now.
bool has_ptp_time(ArvCamera* camera);

}  // namespace kinevox
