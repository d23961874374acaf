// One camera's pictures as a codec's bytes.
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
    kUtVideo,  // lossless, intra only: a third more bytes, a quarter of the computing time
    kH264,     // near-lossless, a key frame at least twice a second
};

std::string_view name_of(VideoCodec codec);  // "ffv1", "utvideo", "h264"
// Frames from one that can be decoded without those before to the next, at most.
int key_distance(VideoCodec codec, double fps);

// As it will lie in the file; shared, since the rolling buffer and a file may both hold it.
struct EncodedPicture {
    std::string bytes;
    bool key = false;      // can be decoded without those before it
    bool missing = false;  // a stand-in for what the camera did not deliver
};

// What a video's header says.
struct VideoFormat {
    VideoCodec codec = VideoCodec::kUtVideo;
    int width = 0, height = 0;  // px
    double fps = 0;
    std::string extra_data;  // the codec's
};

// Used by one thread at a time.
class PictureEncoder {
  public:
    // InvalidArgument where the codec cannot take pictures of this size; Unavailable where FFmpeg lacks it.
    static absl::StatusOr<std::unique_ptr<PictureEncoder>> create(const Camera& camera, double fps,
                                                                  VideoCodec codec);
    virtual ~PictureEncoder() = default;

    virtual const VideoFormat& format() const = 0;

    // B G R or grey, of the camera's size; an empty picture gets a stand-in, black or the one before, and is
    // marked. `key`: what follows shall not need what came before.
    virtual absl::StatusOr<std::shared_ptr<const EncodedPicture>> encode(const Picture& picture,
                                                                         bool key) = 0;
};

}  // namespace kinevox
