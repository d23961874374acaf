// A video that the recorder wrote: any of its pictures at once, exact to the bit where its codec is lossless.
// Read by its index (common/recording_files.h), not by the container's, so that one that was cut off is read
// like any other.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "common/recording_files.h"
#include "server/cameras/picture_reader.h"

namespace kinevox {

// Used by one thread at a time.
class RecordedVideo : public PictureReader {
  public:
    // `max_frames`: as if there were no more, for videos that must end together; negative: all. NotFound
    // without a video or an index; InvalidArgument where they cannot be read or the pictures are not of the
    // camera's size.
    static absl::StatusOr<std::unique_ptr<RecordedVideo>> open(const std::filesystem::path& video,
                                                               const Camera& camera,
                                                               std::int64_t max_frames = -1);
    // Whether the recorder wrote it.
    static bool is_one(const std::filesystem::path& video);

    virtual std::int64_t size() const = 0;  // frames

    // Picture `frame`, B G R; empty where the camera had delivered none. From a lossless video it costs the
    // decoding of that one picture, from another that of at most half a second more unless it follows the one
    // read last. OutOfRange beyond the last; DataLoss for a picture that cannot be decoded.
    virtual absl::StatusOr<Picture> read(std::int64_t frame) = 0;

    // What next() will deliver. OutOfRange beyond size().
    virtual absl::Status seek(std::int64_t frame) = 0;
};

}  // namespace kinevox
