// A recording, or what `kinevox process` wrote, as files of other programs.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "server/recording/long_work.h"
#include "server/recording/trial.h"

namespace kinevox {

inline constexpr std::string_view kExportFormats[] = {"trc", "mot", "c3d", "bvh",
                                                      "csv", "ply", "mp4", "session"};

struct ExportOptions {
    std::string format;                             // one of kExportFormats
    std::int64_t first_frame = 0, last_frame = -1;  // both included; -1: to the end
    double turn_rad = 0;          // about the vertical, anticlockwise from above; not for mp4
    bool hold = false;            // bvh: where a value is withheld, repeat the last measured one
    std::string camera;           // mp4: empty: all in tiles
    int width_px = 0;             // mp4: see OverlayOptions
    bool anonymous = false;       // no pictures, colours and names: mp4 shows silhouettes; session wants it
    bool beside_capture = false;  // what is computed leaves the other cores alone
};

struct ExportedFiles {
    std::vector<std::filesystem::path> files;
    std::int64_t frames = 0;  // in them
    double rate_hz = 0;       // of the trial; 0: not known
    std::string remark;       // one line where there is something to know
};

// `from`: a folder that `kinevox process` wrote, or a recording's session.toml or folder, whose stored poses
// and volumes are taken. Writes into `out`: the file, or for ply and session the folder of files (for session
// it is there and empty). InvalidArgument, NotFound, FailedPrecondition; Cancelled after `work.stop`. What
// was written before an error is for the caller to remove.
absl::StatusOr<ExportedFiles> export_recording(const std::filesystem::path& from,
                                               const ExportOptions& options, const std::filesystem::path& out,
                                               const LongWork& work);

}  // namespace kinevox
