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
    static absl::StatusOr<std::unique_ptr<VolumeFile>> create(const std::filesystem::path& file);

    // `encoded`: encode_volume()'s; frames increase.
    absl::Status append(std::uint64_t frame, std::string_view encoded);
    void sync() const { file_.sync(); }
    std::uint64_t bytes() const { return file_.size(); }

  private:
    explicit VolumeFile(AppendFile file) : file_(std::move(file)) {}
    AppendFile file_;
};

// Reads it; an incomplete volume at the end is ignored.
class VolumeFileReader {
  public:
    // NotFound, InvalidArgument.
    static absl::StatusOr<VolumeFileReader> open(const std::filesystem::path& file);

    struct Entry {
        std::uint64_t frame = 0, offset = 0;
        std::uint32_t bytes = 0;
    };
    const std::vector<Entry>& entries() const { return entries_; }
    // InvalidArgument or DataLoss name the file and the frame.
    absl::StatusOr<Volume> read(const Entry& entry) const;

  private:
    std::filesystem::path file_;
    std::vector<Entry> entries_;
};

}  // namespace kinevox
