// Applies the configuration to a camera's features; only for the .cc files of this folder.
#pragma once

#include <absl/status/status.h>

#include "common/live_camera_config.h"
#include "server/cameras/aravis/aravis_handles.h"

namespace kinevox {

// Pixel format, region, exposure, gain, white balance, rate and trigger. InvalidArgument names the camera,
// the key, its value and the camera's reason.
absl::Status apply_settings(ArvCamera* camera, const LiveSourceConfig& config, const LiveCameraConfig& of,
                            int width, int height);

// Enables PTP if the camera supports it.
void enable_ptp(ArvCamera* camera);
// Whether its clock is synchronised by PTP now.
bool has_ptp_time(ArvCamera* camera);

}  // namespace kinevox
