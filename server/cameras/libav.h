// RAII for FFmpeg's objects, and the conversion of images for H.264. Only for .cc files: no public header
// exposes FFmpeg.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

#include "server/cameras/image_pool.h"

namespace kinevox::libav {

struct Delete {
    void operator()(AVCodecContext* p) const { avcodec_free_context(&p); }
    void operator()(AVFrame* p) const { av_frame_free(&p); }
    void operator()(AVPacket* p) const { av_packet_free(&p); }
    void operator()(SwsContext* p) const { sws_freeContext(p); }
    // For output: closes the file that it opened.
    void operator()(AVFormatContext* p) const {
        if (p->pb && !(p->flags & AVFMT_FLAG_CUSTOM_IO)) avio_closep(&p->pb);
        avformat_free_context(p);
    }
};
template <typename T>
using Owned = std::unique_ptr<T, Delete>;

// For input.
struct CloseInput {
    void operator()(AVFormatContext* p) const { avformat_close_input(&p); }
};
using OwnedInput = std::unique_ptr<AVFormatContext, CloseInput>;

// FFmpeg's message for an error code.
inline std::string reason(int error) {
    char text[AV_ERROR_MAX_STRING_SIZE] = {};
    av_strerror(error, text, sizeof text);
    return text;
}

}  // namespace kinevox::libav

namespace kinevox {

// Converts B G R images to YUV 4:2:0 planes for H.264. One thread at a time.
class YuvOfBgr {
  public:
    // Pixels; even sides.
    YuvOfBgr(int width, int height)
        : width_(width),
          height_(height),
          scaler_(sws_getContext(width, height, AV_PIX_FMT_BGR24, width, height, AV_PIX_FMT_YUV420P,
                                 SWS_AREA | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP, nullptr, nullptr,
                                 nullptr)),
          last_rows_(static_cast<std::size_t>(kLastRows) * 3 * width + kImagePaddingBytes) {}

    // `bgr`: width * height * 3 bytes, row by row without gaps; `yuv`: a frame of AV_PIX_FMT_YUV420P with
    // buffers of its own.
    void convert(const std::uint8_t* bgr, AVFrame& yuv) {
        const int stride = 3 * width_, rows = std::max(height_ - kLastRows, 0);
        if (rows > 0) sws_scale(scaler_.get(), &bgr, &stride, 0, rows, yuv.data, yuv.linesize);
        const std::uint8_t* const begin = bgr + static_cast<std::size_t>(rows) * stride;
        std::copy(begin, bgr + static_cast<std::size_t>(height_) * stride, last_rows_.begin());
        const std::uint8_t* const last = last_rows_.data();
        sws_scale(scaler_.get(), &last, &stride, rows, height_ - rows, yuv.data, yuv.linesize);
    }

  private:
    static constexpr int kLastRows = 2;  // they share a row of chroma
    int width_, height_;
    libav::Owned<SwsContext> scaler_;
    std::vector<std::uint8_t> last_rows_;
};

}  // namespace kinevox
