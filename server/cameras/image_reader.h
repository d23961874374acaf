// Reads the recorded images of one camera: a folder of images, a video in any container, or a video of the
// recorder.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/recording_files.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// In sequence. Used by one thread at a time.
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

// Exact random access to a video in any container that FFmpeg reads: MP4, MOV, AVI, Matroska, ...
// Images are numbered in presentation order, whatever their timestamps. A seek decodes from the preceding key
// frame, or from the start if the container has no index; images near the last seek are cached, so that steps
// back are cheap. Errors as open_images().
absl::StatusOr<std::unique_ptr<ImageReader>> open_container_video(const std::filesystem::path& file,
                                                                  const Camera& camera);

// Random access to a video of the recorder, bit-exact if its codec is lossless. Uses the recorder's index
// (common/recording_files.h) rather than the container's, so that truncated videos are readable, too.
//
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
    absl::Status seek(std::int64_t frame) override = 0;
};

}  // namespace kinevox
