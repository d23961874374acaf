// Encodes one camera's images.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

enum class VideoCodec {
    kFfv1,     // lossless, intra only
    kUtVideo,  // lossless, intra only: a third more bytes than FFV1, a quarter of its CPU time
    kH264,     // near-lossless, at least two key frames per second
};

std::string_view name_of(VideoCodec codec);  // "ffv1", "utvideo", "h264"
// Maximum distance between key frames, in frames.
int key_distance(VideoCodec codec, double fps);

// As in the file; shared by the rolling buffer and the file.
struct EncodedImage {
    std::string bytes;
    bool key = false;      // can be decoded without earlier ones
    bool missing = false;  // placeholder of an image that the camera did not deliver
};

// The contents of a video's header.
struct VideoFormat {
    VideoCodec codec = VideoCodec::kUtVideo;
    int width = 0, height = 0;  // px
    double fps = 0;
    std::string extra_data;  // the codec's
};

// Used by one thread at a time.
class ImageEncoder {
  public:
    // InvalidArgument if the codec does not support the image size; Unavailable if FFmpeg lacks the codec.
    static absl::StatusOr<std::unique_ptr<ImageEncoder>> create(const Camera& camera, double fps,
                                                                VideoCodec codec);
    virtual ~ImageEncoder() = default;

    virtual const VideoFormat& format() const = 0;

    // BGR or grey, of the camera's size; an empty image becomes a marked placeholder, black or the one
    // before. `key`: makes it a key frame.
    virtual absl::StatusOr<std::shared_ptr<const EncodedImage>> encode(const Image& image, bool key) = 0;
};

}  // namespace kinevox
