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
    double fps = 0, duration_s = 0;
    std::uint64_t size_bytes = 0;  // of all files in its folder
    std::vector<std::string> cameras;
    bool has_background = false;
    SessionRecording about;
};

// From a recording's session; the name is its folder's. `last_time_ns`: of the last frame set, from the
// first; nullopt: there is none.
RecordingInfo recording_info(const Session& session, const std::filesystem::path& session_file,
                             std::optional<std::int64_t> last_time_ns, std::uint64_t size_bytes);

// Of all files in a recording's folder, but for hidden ones.
std::uint64_t recording_size_bytes(const std::filesystem::path& folder);

// Empty if the name is valid, else what is wrong with it.
std::string recording_name_problem(const std::string& name);

// InvalidArgument for an invalid name, NotFound if there is no such recording.
absl::StatusOr<std::filesystem::path> recording_session_file(const std::filesystem::path& folder,
                                                             const std::string& name);
absl::StatusOr<RecordingInfo> read_recording(const std::filesystem::path& folder, const std::string& name);
// Oldest first; folders that are no readable recording are skipped.
std::vector<RecordingInfo> list_recordings(const std::filesystem::path& folder);
// Into the folder's bin, from which it can be moved back until the retention empties it. FailedPrecondition
// while it is being written, as below.
absl::Status move_recording_to_bin(const std::filesystem::path& folder, const std::string& name);
// At once and for good.
absl::Status delete_recording(const std::filesystem::path& folder, const std::string& name);
// Removes what an interrupted deletion left.
void sweep_deleted(const std::filesystem::path& folder);

// The bin: one folder per deleted recording, FOLDER/deleted/NAME. A second one of a name replaces the first.
inline constexpr const char* kBinFolder = "deleted";
struct BinEntry {
    std::filesystem::path folder;
    std::int64_t delete_time_utc_ns = 0;
    std::uint64_t size_bytes = 0;
};
// First the one deleted first.
std::vector<BinEntry> list_bin(const std::filesystem::path& folder);

}  // namespace kinevox
