// The recordings in a folder, and the automatic deletion of old ones.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/bin.h"
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

// The bin (common/bin.h): one folder per deleted recording, FOLDER/deleted/NAME. A second one of a name
// replaces the first.
struct BinEntry {
    std::filesystem::path folder;
    std::int64_t delete_time_utc_ns = 0;
    std::uint64_t size_bytes = 0;
};
// First the one deleted first.
std::vector<BinEntry> list_bin(const std::filesystem::path& folder);

// Of the automatic deletion.
struct RetentionLimits {
    double retention_days = 0;          // since a recording began; 0: unlimited
    std::uint64_t max_total_bytes = 0;  // of all recordings together; 0: unlimited
    bool none() const { return retention_days <= 0 && max_total_bytes == 0; }
};

// A recording whose folder contains a file of this name is never deleted automatically; its bytes count.
inline constexpr const char* kPinnedFile = "pinned";

// Names of the recordings to delete, oldest first: all that are too old, then the oldest until the others are
// within max_total_bytes; never one that is being written or has kPinnedFile.
std::vector<std::string> due_for_deletion(const std::vector<RecordingInfo>& recordings,
                                          const RetentionLimits& limits, std::int64_t now_utc_ns);

// Empties the bin of what was deleted more than kBinDays ago, and of more, first deleted first, while the
// folder exceeds max_total_bytes; then deletes those recordings and the remains of interrupted deletions.
// Reports each deleted recording with its status. Waits for files. `spared`: the session.toml that is being
// replayed; it is not deleted.
void apply_retention(const std::filesystem::path& folder, const RetentionLimits& limits,
                     std::int64_t now_utc_ns, const std::filesystem::path& spared,
                     const std::function<void(const std::string& name, const absl::Status& deleted)>& report);

}  // namespace kinevox
