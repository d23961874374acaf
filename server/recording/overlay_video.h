// A video of a session's images with the measured skeleton drawn over them.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "common/session_file.h"
#include "server/recording/job_control.h"
#include "server/recording/trial.h"

namespace kinevox {

struct OverlayOptions {
    std::string camera;  // empty: all, tiled
    int width_px = 0;    // of the video; 0: that of the images, up to 1280
    bool silhouettes =
        false;  // the images are white on black: shown in greys on which the skeleton is visible
};

// H.264 in MP4, one image per frame of the trial. Withheld joints are not drawn; a lost frame set repeats the
// image and the skeleton of the frame before. NotFound for an unknown camera; Cancelled after `work.stop`;
// errors of reading and writing.
absl::Status write_overlay_video(const Session& session, const Trial& trial, const OverlayOptions& options,
                                 const std::filesystem::path& file, const JobControl& work);

}  // namespace kinevox
