// Exact random access to a video in any container that FFmpeg reads: MP4, MOV, AVI, Matroska, ...
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>

#include "common/camera.h"
#include "server/cameras/image_reader.h"

namespace kinevox {

// Images are numbered in presentation order, whatever their timestamps. A seek decodes from the preceding key
// frame, or from the start if the container has no index; images near the last seek are cached, so that steps
// back are cheap. Errors as open_images().
absl::StatusOr<std::unique_ptr<ImageReader>> open_container_video(const std::filesystem::path& file,
                                                                  const Camera& camera);

}  // namespace kinevox
