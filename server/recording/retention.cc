#include "server/recording/retention.h"

#include <algorithm>

namespace kinevox {
namespace {

constexpr double kDay_ns = 86'400e9;

bool may_go(const RecordingInfo& recording) {
    std::error_code error;
    return recording.about.closed &&
           !std::filesystem::exists(recording.session_file.parent_path() / kKeepFile, error);
}

}  // namespace

std::vector<std::string> due_for_deletion(const std::vector<RecordingInfo>& recordings,
                                          const RetentionLimits& limits, std::int64_t now_utc_ns) {
    std::vector<const RecordingInfo*> oldest_first;
    for (const RecordingInfo& recording : recordings) oldest_first.push_back(&recording);
    std::ranges::stable_sort(oldest_first, {},
                             [](const RecordingInfo* r) { return r->about.started_utc_ns; });
    std::uint64_t bytes = 0;
    for (const RecordingInfo& recording : recordings) bytes += recording.bytes;
    std::vector<std::string> due;
    for (const RecordingInfo* recording : oldest_first) {
        const double age_days = static_cast<double>(now_utc_ns - recording->about.started_utc_ns) / kDay_ns;
        const bool too_old = limits.keep_days > 0 && age_days > limits.keep_days;
        const bool too_much = limits.keep_bytes > 0 && bytes > limits.keep_bytes;
        if ((!too_old && !too_much) || !may_go(*recording)) continue;
        due.push_back(recording->name);
        bytes -= std::min(bytes, recording->bytes);
    }
    return due;
}

void apply_retention(const std::filesystem::path& folder, const RetentionLimits& limits,
                     std::int64_t now_utc_ns, const std::filesystem::path& spared,
                     const std::function<void(const std::string& name, const absl::Status& deleted)>& tell) {
    sweep_deleted(folder);
    if (limits.none()) return;
    std::vector<RecordingInfo> recordings = list_recordings(folder);
    std::erase_if(recordings,
                  [&](const RecordingInfo& r) { return !spared.empty() && r.session_file == spared; });
    for (const std::string& name : due_for_deletion(recordings, limits, now_utc_ns))
        tell(name, delete_recording(folder, name));
}

}  // namespace kinevox
