// Sessions that the recorder wrote and whose end it may not have lived to see.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/recording_files.h"
#include "common/session_file.h"

namespace kinevox {

// The frame sets of a recording that are whole in every file, with their times. InvalidArgument, NotFound;
// DataLoss where there is none. For a session with session.recording.
absl::StatusOr<std::vector<RecordedTime>> whole_frame_sets(const Session& session);

// Closes a recording that was cut off: its files are cut to what is whole, and its session.toml says so.
// False where there was nothing to do: closed, being written, or no recording. Errors where the files cannot
// be changed; they can be read all the same.
absl::StatusOr<bool> repair_recording(const std::filesystem::path& session_file);

}  // namespace kinevox
