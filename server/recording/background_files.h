// The images from which a background was learned, as files.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <stop_token>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Per camera its images of the background.
using BackgroundImages = std::shared_ptr<const std::vector<std::vector<Image>>>;

// Writes per camera `folder`/NAME.mkv, lossless, and its index, replacing existing ones; returns the videos.
// Cancelled if a stop was requested.
absl::StatusOr<std::vector<std::filesystem::path>> write_background_videos(
    const std::filesystem::path& folder, const std::vector<Camera>& cameras, double fps,
    const std::vector<std::vector<Image>>& images, const std::stop_token& stop);

}  // namespace kinevox
