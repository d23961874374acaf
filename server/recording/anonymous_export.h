// `kinevox export --anonymous`: a session that can be shared, silhouettes instead of images, no names, dates
// or machines; or the video of the silhouettes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/session_file.h"
#include "server/recording/recording_export.h"
#include "server/recording/trial.h"

namespace kinevox {

inline constexpr const char* kAnonymous = "anonymous";  // replaces every name

// "cam_01" for the first one: camera names often contain rooms and machines.
std::string anonymous_camera_name(std::size_t camera);

// The tables of the session to export.
struct MeasuredTrials {
    std::vector<Trial> trials;  // one per exported subject, at least one
    int max_at_once = 1;        // subjects in one frame set, exported or not
};

struct AnonymousSession {
    Session session;
    std::vector<std::filesystem::path> files;
};

// Writes a recording (docs/recording.md) into the existing `folder`: videos of the silhouettes of the main
// subject, or of those with trials where there are several, white on black, black backgrounds, calibration,
// volumes without colours and the tables; times count from the first frame set. It has as many frame sets as
// the trials. `one_thread`:
// computed on one thread besides the decoders', next to a running capture. FailedPrecondition if a camera has
// no background; Cancelled after `work.stop`; errors of reading and writing.
absl::StatusOr<AnonymousSession> write_anonymous_session(const Session& session,
                                                         const MeasuredTrials& measured,
                                                         const std::filesystem::path& folder, bool one_thread,
                                                         const JobControl& work);

// README.txt: the contents, what was removed, and what still identifies the subject.
std::string anonymous_readme();

// As export_recording() for the formats mp4 (of `slices`, the requested frames of the trials) and session.
absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const MeasuredTrials& measured,
                                               std::span<const Trial> slices, const ExportOptions& options,
                                               const std::filesystem::path& out, const JobControl& work);

}  // namespace kinevox
