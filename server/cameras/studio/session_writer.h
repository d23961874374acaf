// Writes a session of the virtual studio to disk, with ground truth:
//   session.toml, calibration.toml, CAMERA.mp4, background/CAMERA.mp4,
//   truth/joints.csv (m), truth/angles.csv (degrees), truth/masks_CAMERA/frame_0000.png (0 or 255),
//   truth/mesh/frame_0000.ply (closed triangle mesh, m) every `mesh_stride` frames,
//   with several people: truth/joints_a.csv, angles_a.csv, masks_a_CAMERA of each (what is visible of them),
//   masks_CAMERA of all, truth/target.csv (world_from_target: m, rotation vector in degrees) with a board or
//   a wand, truth/camera_bump.csv and truth/calibration_after_bump.toml with a bumped camera;
//   calibration.toml describes the cameras before the bump.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <functional>

#include "server/cameras/studio/studio.h"

namespace kinevox::studio {

struct SessionWriterOptions {
    std::int64_t frames = 150;   // 1 .. 1000000
    int background_frames = 60;  // 1 .. 10000
    int mesh_stride = 0;         // a mesh every Nth frame; 0: none
    int crf = 12;                // of the videos, as H264Options::crf, 0 .. 51
    bool masks = true;
    std::function<void(std::int64_t done, std::int64_t all)>
        progress;  // called after every frame; may be empty

    // Empty when valid, else one sentence.
    std::string check() const;
};

// The folder must not exist or be empty. session.toml is written last: if it exists, the session is complete.
absl::Status write_session(Studio& studio, const std::filesystem::path& folder,
                           const SessionWriterOptions& options);

}  // namespace kinevox::studio
