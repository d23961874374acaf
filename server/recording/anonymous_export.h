// `kinevox export --anonymous`: the video of the silhouettes, or the whole session without images.
#pragma once

#include <absl/status/statusor.h>

#include "common/session_file.h"
#include "server/recording/recording_export.h"

namespace kinevox {

// As export_recording() for the formats mp4 (of `slice`, the requested frames of the trial) and session.
absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const Trial& trial, const Trial& slice,
                                               const ExportOptions& options, const std::filesystem::path& out,
                                               const JobControl& work);

}  // namespace kinevox
