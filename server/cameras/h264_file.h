// Writes an H.264 MP4 file that preserves sensor noise, unlike OpenCV's writer. Images B G R, 8 bits.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <memory>

#include "server/cameras/frame_source.h"

namespace kinevox {

struct H264Options {
    double fps = 30;
    int crf = 12;  // x264's constant rate factor: 0 lossless, 23 its default; 12 keeps 90 % of the noise
};

class H264File {
  public:
    // Width and height must be even. Unavailable if libavcodec lacks libx264; other errors name the file.
    static absl::StatusOr<std::unique_ptr<H264File>> create(const std::filesystem::path& file, int width,
                                                            int height, const H264Options& options);
    virtual ~H264File() = default;

    virtual absl::Status write(const Image& image) = 0;
    // The file is incomplete until this returns.
    virtual absl::Status close() = 0;
};

}  // namespace kinevox
