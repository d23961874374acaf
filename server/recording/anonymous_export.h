// `kinevox export --anonymous`: the film of the silhouettes, or the whole session without pictures.
#pragma once

#include <absl/status/statusor.h>

#include "common/session_file.h"
#include "server/recording/recording_export.h"

namespace kinevox {

// As export_recording() for the formats mp4 (of `part`, the trial's frames that are asked for) and session.
absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const Trial& trial, const Trial& part,
                                               const ExportOptions& options, const std::filesystem::path& out,
                                               const LongWork& work);

}  // namespace kinevox
