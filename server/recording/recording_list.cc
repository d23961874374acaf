#include "server/recording/recording_list.h"

#include <fmt/format.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "common/recording_files.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxName = 100;
constexpr std::string_view kDeleted = ".deleted-";  // no recording's name begins with a dot

std::uint64_t bytes_of(const fs::path& folder) {
    std::uint64_t bytes = 0;
    std::error_code error;
    for (auto entry = fs::recursive_directory_iterator(folder, error);
         !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
        std::error_code gone;
        const auto size = entry->is_regular_file(gone) ? entry->file_size(gone) : 0;
        if (!gone) bytes += size;
    }
    return bytes;
}

}  // namespace

RecordingInfo recording_info(const Session& session, const fs::path& session_file,
                             std::optional<std::int64_t> last_time_ns, std::uint64_t bytes) {
    RecordingInfo info;
    info.name = session_file.parent_path().filename().string();
    info.session_file = session_file;
    info.fps = session.fps;
    if (last_time_ns) info.seconds = 1e-9 * static_cast<double>(*last_time_ns) + 1 / info.fps;
    info.bytes = bytes;
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
            "the name \"{}\" is not 1 to {} letters, digits, '.', '_' or '-', the first not '.'; choose "
            "another one",
            name.substr(0, 120), kMaxName);
    return {};
}

absl::StatusOr<fs::path> recording_session_file(const fs::path& folder, const std::string& name) {
    if (const std::string problem = recording_name_problem(name); !problem.empty())
        return absl::InvalidArgumentError(problem);
    const fs::path file = folder / name / "session.toml";
    std::error_code error;
    if (!fs::is_regular_file(file, error))
        return absl::NotFoundError(
            fmt::format("there is no recording \"{}\"; see `kinevox record list`", name));
    return file;
}

absl::StatusOr<RecordingInfo> read_recording(const fs::path& folder, const std::string& name) {
    const auto file = recording_session_file(folder, name);
    if (!file.ok()) return file.status();
    const auto session = read_session(*file);
    if (!session.ok()) return session.status();
    if (!session->recording)
        return absl::NotFoundError(
            fmt::format("\"{}\" is a session, but the recorder did not write it", name));
    const auto times = read_recorded_times(session->recording->times);
    if (!times.ok()) return times.status();
    RecordingInfo info =
        recording_info(*session, *file, times->empty() ? std::nullopt : std::optional(times->back().time_ns),
                       bytes_of(file->parent_path()));
    if (!info.about.closed) {  // being written, or never closed
        info.about.frames = times->size();
        if (!times->empty()) info.about.started_utc_ns = times->front().capture_time_utc_ns;
    }
    return info;
}

std::vector<RecordingInfo> list_recordings(const fs::path& folder) {
    std::vector<RecordingInfo> found;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (auto info = read_recording(folder, entry.path().filename().string()); info.ok())
            found.push_back(*std::move(info));
    std::ranges::sort(
        found, {}, [](const RecordingInfo& info) { return std::pair(info.about.started_utc_ns, info.name); });
    return found;
}

absl::Status delete_recording(const fs::path& folder, const std::string& name) {
    const auto info = read_recording(folder, name);
    if (!info.ok()) return info.status();
    if (being_written(info->about.times))
        return absl::FailedPreconditionError(fmt::format("\"{}\" is being recorded; stop that first", name));
    // Under another name it is no recording any more, and what an end in the middle leaves of it is found
    // again.
    std::error_code error;
    const fs::path from = info->session_file.parent_path(), aside = folder / (std::string(kDeleted) + name);
    fs::remove_all(aside, error);
    fs::rename(from, aside, error);
    if (!error) fs::remove_all(aside, error);
    if (error)
        return absl::UnavailableError(
            fmt::format("{}: {}; correct its rights", from.string(), error.message()));
    return absl::OkStatus();
}

void sweep_deleted(const fs::path& folder) {
    std::error_code error;
    std::vector<fs::path> left;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (entry.path().filename().string().starts_with(kDeleted)) left.push_back(entry.path());
    for (const fs::path& each : left) fs::remove_all(each, error);
}

}  // namespace kinevox
