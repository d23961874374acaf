// Random access to a video of the recorder, bit-exact if its codec is lossless. Uses the recorder's index
// (common/recording_files.h) rather than the container's, so that truncated videos are readable, too.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "common/recording_files.h"
#include "server/cameras/image_reader.h"

namespace kinevox {

// Used by one thread at a time.
class RecordedVideo : public ImageReader {
  public:
    // `max_frames` truncates the video, so that all cameras end together; negative: all frames. NotFound
    // without a video or an index; InvalidArgument if they cannot be read or differ from the camera in image
    // size.
    static absl::StatusOr<std::unique_ptr<RecordedVideo>> open(const std::filesystem::path& video,
                                                               const Camera& camera,
                                                               std::int64_t max_frames = -1);
    // Whether the recorder wrote this file.
    static bool is_one(const std::filesystem::path& video);

    virtual std::int64_t size() const = 0;  // frames

    // Image `frame`, B G R; empty if the camera delivered none. A lossless video decodes just this image,
    // others up to half a second more unless it follows the last one read. OutOfRange after the last;
    // DataLoss for an image that cannot be decoded.
    virtual absl::StatusOr<Image> read(std::int64_t frame) = 0;

    // Sets the image that next() delivers. OutOfRange after size().
    virtual absl::Status seek(std::int64_t frame) = 0;
};

}  // namespace kinevox
