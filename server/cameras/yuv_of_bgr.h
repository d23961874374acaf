// Converts B G R images to YUV 4:2:0 planes for H.264.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

struct AVFrame;
struct SwsContext;

namespace kinevox {

// One thread at a time.
class YuvOfBgr {
  public:
    // Pixels; even sides.
    YuvOfBgr(int width, int height);

    // `bgr`: width * height * 3 bytes, row by row without gaps; `yuv`: a frame of AV_PIX_FMT_YUV420P with
    // buffers of its own.
    void convert(const std::uint8_t* bgr, AVFrame& yuv);

  private:
    struct Free {
        void operator()(SwsContext* scaler) const;
    };
    int width_, height_;
    std::unique_ptr<SwsContext, Free> scaler_;
    std::vector<std::uint8_t> last_rows_;
};

}  // namespace kinevox
