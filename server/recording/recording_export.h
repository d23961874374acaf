// Exports a recording or the results of `kinevox process` to the formats of other programs.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/export_options.h"
#include "common/session_file.h"
#include "server/recording/trial.h"

namespace kinevox {

// Cancellation and progress of a job that takes minutes.
struct JobControl {
    const std::atomic<bool>& stop;  // once true, the job ends with Cancelled
    // Called often on the job's thread with the progress, 0 to 1, increasing.
    std::function<void(double)> progress = {};

    void report(double fraction) const {
        if (progress) progress(fraction);
    }
    // For a step of the job: its progress 0 to 1 is `from` to `to` here. Must not outlive this.
    JobControl subrange(double from, double to) const {
        return {stop, [this, from, to](double fraction) { report(from + fraction * (to - from)); }};
    }
};

// A video of a session's images with the measured skeleton drawn over them; in overlay_video.cc.

struct OverlayOptions {
    std::string camera;  // empty: all, tiled
    int width_px = 0;    // of the video; 0: that of the images, up to 1280
    bool silhouettes =
        false;  // the images are white on black: shown in greys on which the skeleton is visible
};

// H.264 in MP4, one image per frame of the trials, which are of one run, one per subject. Withheld joints are
// not drawn; a lost frame set repeats the image and the skeleton of the frame before. NotFound for an unknown
// camera; Cancelled after `work.stop`; errors of reading and writing.
absl::Status write_overlay_video(const Session& session, std::span<const Trial> trials,
                                 const OverlayOptions& options, const std::filesystem::path& file,
                                 const JobControl& work);

struct ExportOptions {
    ExportFormat format = ExportFormat::kCsv;
    std::uint32_t subject_id = 0;            // 0: the only one, see read_trial(); ply, mp4: all
    std::int64_t first_frame = 0;            // both included
    std::optional<std::int64_t> last_frame;  // absent: to the end
    double yaw_rad = 0;          // rotation about the vertical, counter-clockwise from above; not for mp4
    bool hold_withheld = false;  // bvh: repeat the last measured value where one is withheld
    std::string camera;          // mp4: empty: all, tiled
    int width_px = 0;            // mp4: see OverlayOptions
    bool anonymous = false;      // no images, colours and names: mp4 shows silhouettes; session requires it
    bool low_priority = false;   // compute on one core only, next to a running capture
};

struct ExportedFiles {
    std::vector<std::filesystem::path> files;
    std::int64_t frames = 0;  // in them
    double rate_hz = 0;       // of the trial; 0: not known
    std::string warning;      // one line; empty: none
};

// `from`: a folder that `kinevox process` wrote, or a recording's session.toml or folder, whose stored poses
// and volumes are used. Writes `out`: a file, or for formats with many files a folder (for session it exists
// and is empty). InvalidArgument, NotFound, FailedPrecondition; Cancelled after `work.stop`. The caller
// removes what was written before an error.
absl::StatusOr<ExportedFiles> export_recording(const std::filesystem::path& from,
                                               const ExportOptions& options, const std::filesystem::path& out,
                                               const JobControl& work);

// As export_recording() for each subject of the trial, in the existing folder `out`: s2_NAME.c3d, or s2.c3d
// without a name. Not for formats that contain all subjects in many files.
absl::StatusOr<ExportedFiles> export_each_subject(const std::filesystem::path& from,
                                                  const ExportOptions& options,
                                                  const std::filesystem::path& out, const JobControl& work);

}  // namespace kinevox
