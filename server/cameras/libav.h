// RAII for FFmpeg's objects. Only for .cc files: no public header exposes FFmpeg.
#pragma once

#include <memory>
#include <string>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libavutil/pixdesc.h>
#include <libswscale/swscale.h>
}

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
