#include "server/cameras/recorded_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/atomic_file.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMaxTableBytes = std::size_t{1} << 30;

absl::Status cut(const fs::path& file, std::uint64_t bytes) {
    std::error_code error;
    if (fs::file_size(file, error) <= bytes && !error) return absl::OkStatus();
    if (!error) fs::resize_file(file, bytes, error);
    return error ? absl::UnavailableError(
                       fmt::format("{}: {}; it cannot be repaired", file.string(), error.message()))
                 : absl::OkStatus();
}

// Each line of a table begins with its frame. Returns the size in bytes of the header and the complete lines
// of frames below `limit`, and the frame after the last of them.
std::pair<std::size_t, std::uint64_t> complete_lines(std::string_view text, std::uint64_t limit) {
    std::size_t end = text.find('\n') + 1;  // 0 without one
    std::uint64_t next = 0;
    while (end > 0) {
        const std::size_t newline = text.find('\n', end);
        if (newline == std::string_view::npos) break;
        std::uint64_t frame = 0;
        const auto [end_of_number, code] = std::from_chars(text.data() + end, text.data() + newline, frame);
        if (code != std::errc{} || *end_of_number != ',' || frame >= limit) break;
        end = newline + 1;
        next = frame + 1;
    }
    return {end, next};
}

// Cuts all pose tables to the same last frame.
absl::Status cut_poses(const fs::path& folder, std::uint64_t frames) {
    std::vector<std::pair<fs::path, std::string>> tables;
    for (const std::string_view name : kPoseTableNames) {
        auto text = read_file(folder / name, kMaxTableBytes);
        if (!text.ok()) return text.status();
        tables.emplace_back(folder / name, *std::move(text));
    }
    std::uint64_t limit = frames;
    for (std::size_t t = 0; t + 1 < tables.size(); ++t)
        limit = std::min(limit, complete_lines(tables[t].second, limit).second);
    for (const auto& [file, text] : tables)
        if (absl::Status done = cut(file, complete_lines(text, limit).first); !done.ok()) return done;
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<RecordedTime>> complete_frame_sets(const Session& session) {
    auto times = read_recorded_times(session.recording->frame_times);
    if (!times.ok()) return times.status();
    for (const SessionCamera& camera : session.cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        times->resize(std::min(times->size(), index->size()));
    }
    if (times->empty())
        return absl::DataLossError(
            fmt::format("session \"{}\": no complete frame set was recorded; record it again", session.name));
    return times;
}

absl::Status check_intact(const fs::path& session_file) {
    const auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    if (!session->recording || !session->recording->closed) return absl::OkStatus();
    const std::uint64_t stated = session->recording->frame_sets;
    const auto times = read_recorded_times(session->recording->frame_times);
    if (!times.ok()) return times.status();
    std::uint64_t complete = times->size();
    fs::path damaged = session->recording->frame_times;
    for (const SessionCamera& camera : session->cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        if (index->size() >= complete) continue;
        complete = index->size();
        damaged = video_index_file(camera.video);
    }
    if (complete >= stated) return absl::OkStatus();
    return absl::DataLossError(
        fmt::format("{}: damaged after {} of {} frame sets; copy the recording again, or set closed = false "
                    "in {} to cut it to "
                    "the intact ones",
                    damaged.string(), complete, stated, session_file.string()));
}

absl::StatusOr<bool> repair_recording(const fs::path& session_file) {
    auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    if (!session->recording || session->recording->closed || being_written(session->recording->frame_times))
        return false;
    const auto times = complete_frame_sets(*session);
    if (!times.ok()) return times.status();
    SessionRecording& recording = *session->recording;
    const std::size_t frames = times->size();
    for (const SessionCamera& camera : session->cameras) {
        const auto index = read_video_index(camera.video);
        if (!index.ok()) return index.status();
        if (absl::Status done = cut(camera.video, (*index)[frames - 1].end()); !done.ok()) return done;
        if (absl::Status done = cut(video_index_file(camera.video),
                                    kVideoIndexHeader.size() + frames * kVideoIndexEntryBytes);
            !done.ok())
            return done;
        recording.missing_images += static_cast<std::uint64_t>(std::count_if(
            index->begin(), index->begin() + static_cast<std::ptrdiff_t>(frames),
            [](const VideoIndexEntry& entry) { return entry.flags & VideoIndexEntry::kMissing; }));
    }
    const auto table = read_file(recording.frame_times, kMaxTableBytes);
    if (!table.ok()) return table.status();
    if (absl::Status done = cut(recording.frame_times, complete_lines(*table, frames).first); !done.ok())
        return done;
    if (!recording.poses.empty())
        if (absl::Status done = cut_poses(recording.poses, frames); !done.ok()) return done;
    std::error_code ignored;
    fs::remove(session_file.parent_path() / ".reserve", ignored);
    recording.frame_sets = frames;
    recording.start_time_utc_ns = times->front().capture_time_utc_ns;
    recording.lost_frame_sets = times->back().sequence - times->front().sequence + 1 - frames;
    recording.closed = recording.recovered = true;
    recording.end_reason = "the recording program was killed";
    if (absl::Status written = write_session(*session, session_file); !written.ok()) return written;
    return true;
}

}  // namespace kinevox
