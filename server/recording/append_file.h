// A file that only grows, by atomic appends.
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
    // Creates it; AlreadyExists, or Unavailable and ResourceExhausted as below.
    static absl::StatusOr<AppendFile> create(const std::filesystem::path& file);
    AppendFile(AppendFile&& other) noexcept;
    AppendFile& operator=(AppendFile&& other) noexcept;
    ~AppendFile();

    // All or nothing. ResourceExhausted if the disk is full, else Unavailable; the message names the file.
    absl::Status append(std::string_view bytes);
    // Overwrites, growing the file if needed.
    absl::Status write_at(std::uint64_t offset, std::string_view bytes);
    absl::Status truncate(std::uint64_t bytes);
    void sync() const;  // blocks until the disk has it
    // While the file is open, being_written() is true for others. False: another process holds the lock.
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
