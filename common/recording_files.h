// The files next to a recorded session's videos: an index per camera and a table of times. Both are only
// appended to, so that an interrupted recording is complete up to the interruption. docs/recording.md defines
// the bytes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace kinevox {

// One image in a video. 32 bytes in the file, little endian, in this order.
struct VideoIndexEntry {
    std::uint64_t payload_offset = 0;  // of the image's bytes in the video file, as its decoder reads them
    std::uint64_t cluster_offset = 0;  // of its own Matroska cluster, which ends after the payload
    std::int64_t time_ns = 0;          // since the recording's first frame set
    std::uint32_t payload_bytes = 0;
    std::uint32_t flags = 0;  // kKey, kMissing

    static constexpr std::uint32_t kKey = 1;      // key frame
    static constexpr std::uint32_t kMissing = 2;  // placeholder: the camera delivered no image
    std::uint64_t end() const { return payload_offset + payload_bytes; }
    bool operator==(const VideoIndexEntry&) const = default;
};

inline constexpr std::string_view kVideoIndexHeader{"KVXINDEX\1\0\0\0\x20\0\0\0", 16};
inline constexpr std::size_t kVideoIndexEntryBytes = 32;

// "cam1.mkv" -> "cam1.index".
std::filesystem::path video_index_file(const std::filesystem::path& video);

std::string video_index_bytes(const VideoIndexEntry& entry);

// The entries whose images are complete in a video of `video_bytes`, up to the first invalid one; an
// incomplete entry at the end is ignored. InvalidArgument if the file is no index.
absl::StatusOr<std::vector<VideoIndexEntry>> parse_video_index(std::string_view bytes,
                                                               std::uint64_t video_bytes);
// NotFound if one of the two files is missing.
absl::StatusOr<std::vector<VideoIndexEntry>> read_video_index(const std::filesystem::path& video);

// One line of frames.csv.
struct RecordedTime {
    std::uint64_t sequence = 0;  // at the source; gaps are lost frame sets
    std::int64_t time_ns = 0;    // since the recording's first frame set
    std::int64_t capture_time_utc_ns = 0;
    bool operator==(const RecordedTime&) const = default;
};

inline constexpr std::string_view kRecordedTimesHeader = "frame,sequence,time_ns,capture_time_utc_ns\n";

std::string recorded_time_line(std::uint64_t frame, const RecordedTime& time);

// Up to the first line that is incomplete or does not follow the one before.
absl::StatusOr<std::vector<RecordedTime>> parse_recorded_times(std::string_view text,
                                                               const std::string& name_for_errors);
absl::StatusOr<std::vector<RecordedTime>> read_recorded_times(const std::filesystem::path& file);

// The pose tables, in their folder; all but the last have one row per frame and subject.
inline constexpr std::array<std::string_view, 5> kPoseTableNames{
    "joints.csv", "angles.csv", "coordinates.csv", "uncertainty.csv", "withheld.csv"};

// Whether a running process, this one or another, holds the lock of a file that it writes.
bool being_written(const std::filesystem::path& file);

}  // namespace kinevox
