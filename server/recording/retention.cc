#include "server/recording/retention.h"

#include <algorithm>

namespace kinevox {
namespace {

constexpr double kDay_ns = 86'400e9;

bool may_be_deleted(const RecordingInfo& recording) {
    std::error_code error;
    return recording.about.closed &&
           !std::filesystem::exists(recording.session_file.parent_path() / kPinnedFile, error);
}

void empty_bin(const std::filesystem::path& folder, const std::vector<RecordingInfo>& recordings,
               const RetentionLimits& limits, std::int64_t now_utc_ns) {
    const std::vector<BinEntry> bin = list_bin(folder);
    std::uint64_t bytes = 0;
    for (const RecordingInfo& recording : recordings) bytes += recording.size_bytes;
    for (const BinEntry& entry : bin) bytes += entry.size_bytes;
    for (const BinEntry& entry : bin) {
        const bool too_old = static_cast<double>(now_utc_ns - entry.delete_time_utc_ns) > kBinDays * kDay_ns;
        const bool too_much = limits.max_total_bytes > 0 && bytes > limits.max_total_bytes;
        if (!too_old && !too_much) continue;
        std::error_code ignored;
        std::filesystem::remove_all(entry.folder, ignored);
        bytes -= std::min(bytes, entry.size_bytes);
    }
}

}  // namespace

std::vector<std::string> due_for_deletion(const std::vector<RecordingInfo>& recordings,
                                          const RetentionLimits& limits, std::int64_t now_utc_ns) {
    std::vector<const RecordingInfo*> oldest_first;
    for (const RecordingInfo& recording : recordings) oldest_first.push_back(&recording);
    std::ranges::stable_sort(oldest_first, {},
                             [](const RecordingInfo* r) { return r->about.start_time_utc_ns; });
    std::uint64_t bytes = 0;
    for (const RecordingInfo& recording : recordings) bytes += recording.size_bytes;
    std::vector<std::string> due;
    for (const RecordingInfo* recording : oldest_first) {
        const double age_days =
            static_cast<double>(now_utc_ns - recording->about.start_time_utc_ns) / kDay_ns;
        const bool too_old = limits.retention_days > 0 && age_days > limits.retention_days;
        const bool too_much = limits.max_total_bytes > 0 && bytes > limits.max_total_bytes;
        if ((!too_old && !too_much) || !may_be_deleted(*recording)) continue;
        due.push_back(recording->name);
        bytes -= std::min(bytes, recording->size_bytes);
    }
    return due;
}

void apply_retention(
    const std::filesystem::path& folder, const RetentionLimits& limits, std::int64_t now_utc_ns,
    const std::filesystem::path& spared,
    const std::function<void(const std::string& name, const absl::Status& deleted)>& report) {
    sweep_deleted(folder);
    std::vector<RecordingInfo> recordings = list_recordings(folder);
    empty_bin(folder, recordings, limits, now_utc_ns);
    if (limits.none()) return;
    std::erase_if(recordings,
                  [&](const RecordingInfo& r) { return !spared.empty() && r.session_file == spared; });
    for (const std::string& name : due_for_deletion(recordings, limits, now_utc_ns))
        report(name, delete_recording(folder, name));
}

}  // namespace kinevox
