#include "server/recording/recording_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <system_error>
#include <utility>

#include "common/recording_files.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxName = 100;
constexpr std::string_view kDeleted = ".deleted-";  // no recording's name begins with a dot

absl::Status not_deleted(const fs::path& folder, const std::error_code& error) {
    return absl::UnavailableError(
        fmt::format("{}: {}; correct its permissions", folder.string(), error.message()));
}

// The folder of a recording that may be deleted.
absl::StatusOr<fs::path> deletable_folder(const fs::path& folder, const std::string& name) {
    const auto info = read_recording(folder, name);
    if (!info.ok()) return info.status();
    if (being_written(info->about.frame_times))
        return absl::FailedPreconditionError(fmt::format("\"{}\" is being recorded; stop that first", name));
    return info->session_file.parent_path();
}

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

std::uint64_t recording_size_bytes(const fs::path& folder) {
    std::uint64_t bytes = 0;
    std::error_code error;
    for (auto entry = fs::recursive_directory_iterator(folder, error);
         !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
        std::error_code gone;
        const bool counts =
            entry->is_regular_file(gone) && !entry->path().filename().string().starts_with('.');
        const auto size = counts ? entry->file_size(gone) : 0;
        if (!gone) bytes += size;
    }
    return bytes;
}

RecordingInfo recording_info(const Session& session, const fs::path& session_file,
                             std::optional<std::int64_t> last_time_ns, std::uint64_t size_bytes) {
    RecordingInfo info;
    info.name = session_file.parent_path().filename().string();
    info.session_file = session_file;
    info.fps = session.fps;
    if (last_time_ns) info.duration_s = 1e-9 * static_cast<double>(*last_time_ns) + 1 / info.fps;
    info.size_bytes = size_bytes;
    info.about = *session.recording;
    for (const SessionCamera& camera : session.cameras) {
        info.cameras.push_back(camera.name);
        info.has_background = info.has_background || !camera.background.empty();
    }
    return info;
}

std::string recording_name_problem(const std::string& name) {
    const auto allowed = [](char c) {
        return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '.' ||
               c == '_' || c == '-';
    };
    if (name.empty() || name.size() > kMaxName || name.front() == '.' || !std::ranges::all_of(name, allowed))
        return fmt::format(
            "name \"{}\" is invalid; use 1 to {} letters, digits, '.', '_' or '-', not beginning with '.'",
            name.substr(0, 120), kMaxName);
    return {};
}

absl::StatusOr<fs::path> recording_session_file(const fs::path& folder, const std::string& name) {
    if (const std::string problem = recording_name_problem(name); !problem.empty())
        return absl::InvalidArgumentError(problem);
    const fs::path file = folder / name / "session.toml";
    std::error_code error;
    if (!fs::is_regular_file(file, error))
        return absl::NotFoundError(fmt::format("no recording \"{}\"; see `kinevox record list`", name));
    return file;
}

absl::StatusOr<RecordingInfo> read_recording(const fs::path& folder, const std::string& name) {
    const auto file = recording_session_file(folder, name);
    if (!file.ok()) return file.status();
    const auto session = read_session(*file);
    if (!session.ok()) return session.status();
    if (!session->recording)
        return absl::NotFoundError(fmt::format("\"{}\" is a session, but no recording", name));
    const auto times = read_recorded_times(session->recording->frame_times);
    if (!times.ok()) return times.status();
    RecordingInfo info =
        recording_info(*session, *file, times->empty() ? std::nullopt : std::optional(times->back().time_ns),
                       recording_size_bytes(file->parent_path()));
    if (!info.about.closed) {  // being written, or never closed
        info.about.frame_sets = times->size();
        if (!times->empty()) info.about.start_time_utc_ns = times->front().capture_time_utc_ns;
    }
    return info;
}

std::vector<RecordingInfo> list_recordings(const fs::path& folder) {
    std::vector<RecordingInfo> found;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (auto info = read_recording(folder, entry.path().filename().string()); info.ok())
            found.push_back(*std::move(info));
    std::ranges::sort(found, {}, [](const RecordingInfo& info) {
        return std::pair(info.about.start_time_utc_ns, info.name);
    });
    return found;
}

absl::Status move_recording_to_bin(const fs::path& folder, const std::string& name) {
    const auto from = deletable_folder(folder, name);
    if (!from.ok()) return from.status();
    std::error_code error;
    const fs::path bin = folder / kBinFolder, to = bin / name;
    fs::create_directories(bin, error);
    fs::remove_all(to, error);
    if (!error) fs::rename(*from, to, error);
    if (error) return not_deleted(*from, error);
    fs::last_write_time(to, fs::file_time_type::clock::now(), error);  // when it was deleted
    return absl::OkStatus();
}

absl::Status delete_recording(const fs::path& folder, const std::string& name) {
    const auto from = deletable_folder(folder, name);
    if (!from.ok()) return from.status();
    // A hidden name is no recording; sweep_deleted() finds what an interrupted deletion leaves of it.
    std::error_code error;
    const fs::path hidden = folder / (std::string(kDeleted) + name);
    fs::remove_all(hidden, error);
    fs::rename(*from, hidden, error);
    if (!error) fs::remove_all(hidden, error);
    return error ? not_deleted(*from, error) : absl::OkStatus();
}

std::vector<BinEntry> list_bin(const fs::path& folder) {
    std::vector<BinEntry> found;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder / kBinFolder, error)) {
        std::error_code gone;
        const auto time = entry.last_write_time(gone);
        if (gone || !entry.is_directory(gone)) continue;
        const auto utc = std::chrono::file_clock::to_sys(time).time_since_epoch();
        found.push_back({entry.path(), std::chrono::duration_cast<std::chrono::nanoseconds>(utc).count(),
                         recording_size_bytes(entry.path())});
    }
    std::ranges::sort(
        found, {}, [](const BinEntry& entry) { return std::pair(entry.delete_time_utc_ns, entry.folder); });
    return found;
}

void sweep_deleted(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> left;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (entry.path().filename().string().starts_with(kDeleted)) left.push_back(entry.path());
    for (const fs::path& each : left) fs::remove_all(each, error);
}

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
