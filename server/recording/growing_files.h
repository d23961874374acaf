// Files that grow while a recording runs, and are readable whenever it ends.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string_view>

#include "server/recording/image_encoder.h"

namespace kinevox {

// A file that only grows, by atomic appends. One thread; sync() by another too.
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

// One camera's recorded video: Matroska with one cluster per image, and its index next to it.
//
// One thread; sync() by another too.
class VideoFile {
  public:
    // Creates `video` (.mkv) and its index. Errors as AppendFile's.
    static absl::StatusOr<std::unique_ptr<VideoFile>> create(const std::filesystem::path& video,
                                                             const VideoFormat& format);
    virtual ~VideoFile() = default;

    // Times increase from 0. After an error both files end with the image before.
    virtual absl::Status append(const EncodedImage& image, std::int64_t time_ns) = 0;
    // Removes the latest image, of a frame set that failed for another camera. At most once after each
    // append().
    virtual absl::Status take_back() = 0;
    // Writes the length and the key frame positions for players. The images can be read without them, so an
    // error is harmless.
    virtual absl::Status close() = 0;
    virtual void sync() const = 0;

    virtual std::uint64_t frames() const = 0;
    virtual std::uint64_t bytes() const = 0;  // of both files
};

}  // namespace kinevox
