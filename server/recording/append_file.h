// A file that only grows: what is written is whole or not there.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace kinevox {

// One thread; sync() by another too.
class AppendFile {
  public:
    AppendFile() = default;
    // Makes it; AlreadyExists where it is there. Unavailable, or ResourceExhausted for a full disk, as below.
    static absl::StatusOr<AppendFile> create(const std::filesystem::path& file);
    AppendFile(AppendFile&& other) noexcept;
    AppendFile& operator=(AppendFile&& other) noexcept;
    ~AppendFile();

    // At the end. What was written of it before an error is taken back: ResourceExhausted where the disk is
    // full, Unavailable else; the message names the file.
    absl::Status append(std::string_view bytes);
    // Over what is there already, growing the file where it reaches beyond.
    absl::Status write_at(std::uint64_t offset, std::string_view bytes);
    absl::Status truncate(std::uint64_t bytes);
    void sync() const;  // waits until the disk has it
    // As long as the file is open others see that it is being written (being_written()). False: somebody else
    // does.
    bool lock() const;

    std::uint64_t size() const { return size_; }
    const std::filesystem::path& path() const { return path_; }
    bool is_open() const { return descriptor_ >= 0; }

  private:
    absl::Status failed(int error) const;

    std::filesystem::path path_;
    int descriptor_ = -1;
    std::uint64_t size_ = 0;
};

}  // namespace kinevox
