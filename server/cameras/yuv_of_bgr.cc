#include "server/cameras/yuv_of_bgr.h"

#include <algorithm>

#include "server/cameras/image_pool.h"
#include "server/cameras/libav.h"

namespace kinevox {
namespace {

constexpr int kLastRows = 2;  // they share a row of chroma

}  // namespace

void YuvOfBgr::Free::operator()(SwsContext* scaler) const {
    sws_freeContext(scaler);
}

YuvOfBgr::YuvOfBgr(int width, int height)
    : width_(width),
      height_(height),
      last_rows_(static_cast<std::size_t>(kLastRows) * 3 * width + kImagePaddingBytes) {
    scaler_.reset(sws_getContext(width, height, AV_PIX_FMT_BGR24, width, height, AV_PIX_FMT_YUV420P,
                                 SWS_AREA | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP, nullptr, nullptr,
                                 nullptr));
}

void YuvOfBgr::convert(const std::uint8_t* bgr, AVFrame& yuv) {
    const int stride = 3 * width_, rows = std::max(height_ - kLastRows, 0);
    if (rows > 0) sws_scale(scaler_.get(), &bgr, &stride, 0, rows, yuv.data, yuv.linesize);
    const std::uint8_t* const begin = bgr + static_cast<std::size_t>(rows) * stride;
    std::copy(begin, bgr + static_cast<std::size_t>(height_) * stride, last_rows_.begin());
    const std::uint8_t* const last = last_rows_.data();
    sws_scale(scaler_.get(), &last, &stride, rows, height_ - rows, yuv.data, yuv.linesize);
}

}  // namespace kinevox
