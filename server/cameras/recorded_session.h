// Reading and repair of recordings, which may be truncated if the recorder was killed.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/recording_files.h"
#include "common/session_file.h"

namespace kinevox {

// The times of the frame sets that are complete in every file. InvalidArgument, NotFound; DataLoss if there
// are none. Requires session.recording.
absl::StatusOr<std::vector<RecordedTime>> complete_frame_sets(const Session& session);

// DataLoss if a closed recording, or one that was repaired, has fewer complete frame sets than it states: one
// of its indices, videos or the table of times is damaged. Not a recording, or not closed: OK.
absl::Status check_intact(const std::filesystem::path& session_file);

// Repairs a truncated recording: cuts its files to the complete frame sets and updates its session.toml.
// False if there is nothing to do: closed, being written, or not a recording. Errors if the files cannot be
// changed; they remain readable.
absl::StatusOr<bool> repair_recording(const std::filesystem::path& session_file);

}  // namespace kinevox
