// The volumes of a recording, concatenated; docs/recording.md defines the bytes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "common/volume.h"
#include "server/recording/growing_files.h"

namespace kinevox {

class VolumeFile {
  public:
    // The first version, which older programs read, holds at most one volume per frame, without its subject.
    enum class Version : char { kFirst = 1, kWithSubjects = 2 };
    static absl::StatusOr<std::unique_ptr<VolumeFile>> create(const std::filesystem::path& file,
                                                              Version version = Version::kFirst);

    // `encoded`: encode_volume()'s; with subjects it may be empty: tracked, but without a volume. Frames
    // increase, and within a frame the subjects.
    absl::Status append(std::uint64_t frame, std::uint32_t subject_id, std::string_view encoded);
    void sync() const { file_.sync(); }
    std::uint64_t bytes() const { return file_.size(); }

  private:
    VolumeFile(AppendFile file, Version version) : file_(std::move(file)), version_(version) {}
    AppendFile file_;
    Version version_;
};

// Reads both versions; an incomplete volume at the end is ignored.
class VolumeFileReader {
  public:
    // NotFound, InvalidArgument.
    static absl::StatusOr<VolumeFileReader> open(const std::filesystem::path& file);

    struct Entry {
        std::uint64_t frame = 0, offset = 0;
        std::uint32_t bytes = 0;       // of the volume; 0: tracked, but without a volume
        std::uint32_t subject_id = 0;  // 0: the file does not say; the only or first one
        bool first_of_frame = true;    // of the subjects tracked
    };
    const std::vector<Entry>& entries() const { return entries_; }
    // InvalidArgument or DataLoss name the file and the frame.
    absl::StatusOr<Volume> read(const Entry& entry) const;

  private:
    std::filesystem::path file_;
    std::vector<Entry> entries_;
};

}  // namespace kinevox
