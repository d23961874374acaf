// An MP4 file of H.264 that keeps the sensor's noise (OpenCV's own writer smooths it away). Pictures B G R, 8
// bits.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>

#include "server/cameras/frame_source.h"

namespace kinevox {

struct H264Options {
    double fps = 30;
    int quality = 12;  // x264's crf: 0 lossless, 23 its default; 12 leaves nine tenths of the noise
};

class H264File {
  public:
    // Width and height even. Unavailable if this libavcodec has no libx264; else errors name the file.
    static absl::StatusOr<std::unique_ptr<H264File>> create(const std::filesystem::path& file, int width,
                                                            int height, const H264Options& options);
    virtual ~H264File() = default;

    virtual absl::Status write(const Picture& picture) = 0;
    // The file is complete after this, and only then.
    virtual absl::Status close() = 0;
};

}  // namespace kinevox
