// How long recordings are kept where nobody looks after them.
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
    double keep_days = 0;          // since a recording began; 0: for ever
    std::uint64_t keep_bytes = 0;  // of all recordings together; 0: as many as fit on the disk
    bool none() const { return keep_days <= 0 && keep_bytes == 0; }
};

// A file of this name in a recording's folder keeps it, whatever the limits say; its bytes count.
inline constexpr const char* kKeepFile = "keep";

// Names of those that are to go, oldest first: all that are too old, then the oldest until the others are
// within keep_bytes. One that is being written never goes, nor one that has kKeepFile.
std::vector<std::string> due_for_deletion(const std::vector<RecordingInfo>& recordings,
                                          const RetentionLimits& limits, std::int64_t now_utc_ns);

// Deletes them, and what an interrupted deletion left; tells each, or why it could not be. Waits for files.
// `spared` is not deleted: what is being replayed.
void apply_retention(const std::filesystem::path& folder, const RetentionLimits& limits,
                     std::int64_t now_utc_ns, const std::filesystem::path& spared,
                     const std::function<void(const std::string& name, const absl::Status& deleted)>& tell);

}  // namespace kinevox
