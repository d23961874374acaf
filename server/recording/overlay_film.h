// A film of a session's pictures with the measured skeleton drawn over them.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <filesystem>
#include <string>

#include "common/session_file.h"
#include "server/recording/long_work.h"
#include "server/recording/trial.h"

namespace kinevox {

struct OverlayOptions {
    std::string camera;  // empty: all in tiles
    int width_px = 0;    // of the film; 0: as the pictures, 1280 at most
    bool silhouettes =
        false;  // the pictures are white on black: shown in greys, before which the skeleton can be seen
};

// H.264 in MP4, a picture for each frame of the trial, whose frames are the session's; where joints are
// withheld nothing is drawn, and a frame set that was lost repeats the one before. NotFound for an unknown
// camera; Cancelled after `work.stop`; else what reading and writing say.
absl::Status write_overlay_film(const Session& session, const Trial& trial, const OverlayOptions& options,
                                const std::filesystem::path& file, const LongWork& work);

}  // namespace kinevox
