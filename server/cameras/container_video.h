// A video in any container that FFmpeg reads: MP4, MOV, AVI, Matroska, ... Any picture of it, exactly.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>

#include "common/camera.h"
#include "server/cameras/picture_reader.h"

namespace kinevox {

// Pictures count in the order in which they are shown, whatever their times. A seek decodes from the nearest
// key before, or from the begin where the container knows none; pictures around the last ones sought are
// kept, so that steps back cost little. Errors as open_pictures().
absl::StatusOr<std::unique_ptr<PictureReader>> open_container_video(const std::filesystem::path& file,
                                                                    const Camera& camera);

}  // namespace kinevox
