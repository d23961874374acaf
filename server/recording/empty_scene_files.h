// The pictures that a background was learned from, as files.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>
#include <stop_token>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Per camera, the pictures of the empty scene.
using EmptyScene = std::shared_ptr<const std::vector<std::vector<Picture>>>;

// Lossless, per camera `folder`/NAME.mkv and its index, which take the place of those before; their videos.
// Cancelled where a stop was requested.
absl::StatusOr<std::vector<std::filesystem::path>> write_empty_scene(
    const std::filesystem::path& folder, const std::vector<Camera>& cameras, double fps,
    const std::vector<std::vector<Picture>>& pictures, const std::stop_token& stop);

}  // namespace kinevox
