// Automatic deletion of old recordings.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "server/recording/recording_list.h"

namespace kinevox {

struct RetentionLimits {
    double retention_days = 0;          // since a recording began; 0: unlimited
    std::uint64_t max_total_bytes = 0;  // of all recordings together; 0: unlimited
    bool none() const { return retention_days <= 0 && max_total_bytes == 0; }
};

// Time that a deleted recording stays in the bin.
inline constexpr double kBinDays = 7;

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
