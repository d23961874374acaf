// Writes what the virtual studio shows as a session on disk, ground truth beside it:
//   session.toml, calibration.toml, CAMERA.mp4, background/CAMERA.mp4,
//   truth/joints.csv (m), truth/angles.csv (degrees), truth/masks_CAMERA/frame_0000.png (0 or 255),
//   truth/mesh/frame_0000.ply (closed triangle mesh, m) every so many frames,
//   truth/prop.csv (world_from_prop: m, rotation vector in degrees) where a board or a wand is carried,
//   truth/knock.csv and truth/calibration_after_knock.toml where a camera is knocked; calibration.toml is as
//   before it.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <functional>

#include "server/cameras/studio/studio.h"

namespace kinevox::studio {

struct SessionWriterOptions {
    std::int64_t frames = 150;   // 1 .. 1000000
    int background_frames = 60;  // 1 .. 10000
    int mesh_every = 0;          // a mesh every so many frames; 0: none
    int quality = 12;            // of the videos: x264's crf, 0 .. 51
    bool masks = true;
    std::function<void(std::int64_t done, std::int64_t all)> progress;  // after every frame; may be empty

    // Empty when usable, else one sentence.
    std::string check() const;
};

// The folder must not exist or be empty; session.toml is written last, so that a session that has one is
// complete.
absl::Status write_session(Studio& studio, const std::filesystem::path& folder,
                           const SessionWriterOptions& options);

}  // namespace kinevox::studio
