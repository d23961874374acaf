// One camera's recorded video: Matroska with a cluster a picture, and its index beside it.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>

#include "server/recording/picture_encoder.h"

namespace kinevox {

// One thread; sync() by another too.
class VideoFile {
  public:
    // Makes `video` (.mkv) and its index. Errors as AppendFile's.
    static absl::StatusOr<std::unique_ptr<VideoFile>> create(const std::filesystem::path& video,
                                                             const VideoFormat& format);
    virtual ~VideoFile() = default;

    // Times rise, from 0. After an error both files end behind the picture before.
    virtual absl::Status append(const EncodedPicture& picture, std::int64_t time_ns) = 0;
    // Takes the newest picture back, for a frame set that another camera's file had no room for. Once after
    // each append().
    virtual absl::Status take_back() = 0;
    // What players like to find: the length, and where the key frames lie. The pictures can be read without,
    // so an error here costs nothing.
    virtual absl::Status close() = 0;
    virtual void sync() const = 0;

    virtual std::uint64_t frames() const = 0;
    virtual std::uint64_t bytes() const = 0;  // of both files
};

}  // namespace kinevox
