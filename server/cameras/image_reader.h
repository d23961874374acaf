// Reads the recorded images of one camera in sequence: a video or a folder of images.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "server/cameras/frame_source.h"

namespace kinevox {

// Used by one thread at a time.
class ImageReader {
  public:
    virtual ~ImageReader() = default;

    // Number of images according to the file; -1 if unknown.
    virtual std::int64_t promised() const = 0;
    // True: promised() is exact (a folder, an index in the container); false: estimated from duration and
    // rate.
    virtual bool promise_is_exact() const = 0;
    // Exact number of images. If promised() is not exact, reads the file once without decoding.
    virtual absl::StatusOr<std::int64_t> count() { return promised(); }

    // The next image, B G R. OutOfRange after the last; InvalidArgument for an image that cannot be decoded
    // or differs from the camera in size.
    virtual absl::StatusOr<Image> next() = 0;

    // Makes next() deliver exactly this image. OutOfRange after the last one, if the count is known.
    virtual absl::Status seek(std::int64_t frame) = 0;

    // Back to the first image.
    virtual absl::Status rewind() = 0;
};

// `camera` provides the name for messages and the required image size. NotFound if the file does not exist,
// InvalidArgument if it contains no readable image or images of another size. A single image file is a clip
// of one image.
absl::StatusOr<std::unique_ptr<ImageReader>> open_images(const std::filesystem::path& file,
                                                         const Camera& camera);

// The error for a `file` whose images are width x height px.
absl::Status wrong_size(const Camera& camera, const std::filesystem::path& file, int width, int height);

}  // namespace kinevox
