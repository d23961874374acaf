// The recordings in a folder.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/session_file.h"

namespace kinevox {

struct RecordingInfo {
    std::string name;
    std::filesystem::path session_file;
    double fps = 0, seconds = 0;
    std::uint64_t bytes = 0;
    std::vector<std::string> cameras;
    bool has_background = false;
    SessionRecording about;
};

// What a recording's session says; its folder has the name. `last_time_ns`: of its last frame set, from the
// first; empty: there is none.
RecordingInfo recording_info(const Session& session, const std::filesystem::path& session_file,
                             std::optional<std::int64_t> last_time_ns, std::uint64_t bytes);

// Empty if a recording may have this name, else what is wrong with it.
std::string recording_name_problem(const std::string& name);

// InvalidArgument for a name that none can have, NotFound where there is no such recording.
absl::StatusOr<std::filesystem::path> recording_session_file(const std::filesystem::path& folder,
                                                             const std::string& name);
absl::StatusOr<RecordingInfo> read_recording(const std::filesystem::path& folder, const std::string& name);
// Oldest first; what is none, or cannot be read, is left out.
std::vector<RecordingInfo> list_recordings(const std::filesystem::path& folder);
// FailedPrecondition while it is being written.
absl::Status delete_recording(const std::filesystem::path& folder, const std::string& name);
// What a deletion left that was cut off.
void sweep_deleted(const std::filesystem::path& folder);

}  // namespace kinevox
