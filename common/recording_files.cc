#include "common/recording_files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <bit>
#include <charconv>
#include <limits>
#include <system_error>

#include "common/files.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxTableBytes = std::size_t{1} << 30;

// Removes a number and the character after it from the front of `text`.
template <typename T>
bool take_number(std::string_view& text, T& value, char after) {
    const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (code != std::errc{} || end == text.data() + text.size() || *end != after) return false;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()) + 1);
    return true;
}

}  // namespace

std::filesystem::path video_index_file(const std::filesystem::path& video) {
    return std::filesystem::path(video).replace_extension(".index");
}

std::string video_index_bytes(const VideoIndexEntry& entry) {
    std::string bytes;
    bytes.reserve(kVideoIndexEntryBytes);
    put_little_endian(bytes, entry.payload_offset);
    put_little_endian(bytes, entry.cluster_offset);
    put_little_endian(bytes, std::bit_cast<std::uint64_t>(entry.time_ns));
    put_little_endian(bytes, entry.payload_bytes);
    put_little_endian(bytes, entry.flags);
    return bytes;
}

absl::StatusOr<std::vector<VideoIndexEntry>> parse_video_index(std::string_view bytes,
                                                               std::uint64_t video_bytes) {
    if (!bytes.starts_with(kVideoIndexHeader))
        return absl::InvalidArgumentError(
            "is not a video index of this version; remove it to read the video without");
    bytes.remove_prefix(kVideoIndexHeader.size());
    std::vector<VideoIndexEntry> entries;
    entries.reserve(bytes.size() / kVideoIndexEntryBytes);
    std::uint64_t after_last = 0;
    while (bytes.size() >= kVideoIndexEntryBytes) {
        VideoIndexEntry entry;
        entry.payload_offset = take_little_endian<std::uint64_t>(bytes);
        entry.cluster_offset = take_little_endian<std::uint64_t>(bytes);
        entry.time_ns = std::bit_cast<std::int64_t>(take_little_endian<std::uint64_t>(bytes));
        entry.payload_bytes = take_little_endian<std::uint32_t>(bytes);
        entry.flags = take_little_endian<std::uint32_t>(bytes);
        const bool sensible =
            entry.cluster_offset >= after_last && entry.payload_offset > entry.cluster_offset &&
            entry.payload_offset <= std::numeric_limits<std::uint64_t>::max() - entry.payload_bytes &&
            entry.end() <= video_bytes && entry.payload_bytes > 0 &&
            (entries.empty() || entry.time_ns > entries.back().time_ns) &&
            (!entries.empty() || entry.flags & VideoIndexEntry::kKey);
        if (!sensible) break;
        after_last = entry.end();
        entries.push_back(entry);
    }
    return entries;
}

absl::StatusOr<std::vector<VideoIndexEntry>> read_video_index(const std::filesystem::path& video) {
    std::error_code error;
    const std::uintmax_t video_bytes = std::filesystem::file_size(video, error);
    if (error)
        return absl::NotFoundError(
            fmt::format("{}: {}; put the video there", video.string(), error.message()));
    const std::filesystem::path file = video_index_file(video);
    const absl::StatusOr<std::string> bytes = read_file(file, kMaxTableBytes);
    if (!bytes.ok()) return bytes.status();
    auto entries = parse_video_index(*bytes, video_bytes);
    if (!entries.ok())
        return absl::InvalidArgumentError(
            fmt::format("{}: {}", file.string(), std::string(entries.status().message())));
    return entries;
}

std::string recorded_time_line(std::uint64_t frame, const RecordedTime& time) {
    return fmt::format("{},{},{},{}\n", frame, time.sequence, time.time_ns, time.capture_time_utc_ns);
}

absl::StatusOr<std::vector<RecordedTime>> parse_recorded_times(std::string_view text,
                                                               const std::string& name_for_errors) {
    if (!text.starts_with(kRecordedTimesHeader))
        return absl::InvalidArgumentError(
            fmt::format("{}:1: is not the header of frames.csv, {}", name_for_errors,
                        kRecordedTimesHeader.substr(0, kRecordedTimesHeader.size() - 1)));
    text.remove_prefix(kRecordedTimesHeader.size());
    std::vector<RecordedTime> times;
    for (;;) {
        std::uint64_t frame = 0;
        RecordedTime time;
        if (!take_number(text, frame, ',') || !take_number(text, time.sequence, ',') ||
            !take_number(text, time.time_ns, ',') || !take_number(text, time.capture_time_utc_ns, '\n'))
            break;
        const bool follows =
            frame == times.size() &&
            (times.empty() ? time.time_ns == 0
                           : time.sequence > times.back().sequence && time.time_ns > times.back().time_ns);
        if (!follows) break;
        times.push_back(time);
    }
    return times;
}

absl::StatusOr<std::vector<RecordedTime>> read_recorded_times(const std::filesystem::path& file) {
    const absl::StatusOr<std::string> text = read_file(file, kMaxTableBytes);
    if (!text.ok()) return text.status();
    return parse_recorded_times(*text, file.string());
}

bool being_written(const std::filesystem::path& file) {
    const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) return false;
    const bool held = ::flock(descriptor, LOCK_SH | LOCK_NB) != 0;
    ::close(descriptor);
    return held;
}

}  // namespace kinevox
