// One camera's recorded video: Matroska with one cluster per image, and its index next to it.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>

#include "server/recording/image_encoder.h"

namespace kinevox {

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
