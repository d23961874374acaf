#include "server/recording/image_encoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

#include "server/cameras/image_mat.h"
#include "server/cameras/libav.h"

namespace kinevox {
namespace {

constexpr double kKeysASecond = 2;

class LibavEncoder final : public ImageEncoder {
  public:
    explicit LibavEncoder(const Camera& camera) : camera_(camera.name) {
        format_.width = camera.width;
        format_.height = camera.height;
    }

    absl::Status open(double fps, VideoCodec codec);
    const VideoFormat& format() const override { return format_; }
    absl::StatusOr<std::shared_ptr<const EncodedImage>> encode(const Image& image, bool key) override;

  private:
    absl::Status failed(const std::string& what) const {
        return absl::UnavailableError(
            fmt::format("camera {}: {} images cannot be encoded ({}); choose another codec", camera_,
                        name_of(format_.codec), what));
    }
    void fill_frame(const Image& image);

    std::string camera_;
    VideoFormat format_;
    libav::Owned<AVCodecContext> encoder_;
    libav::Owned<AVFrame> frame_;
    libav::Owned<AVPacket> packet_;
    std::optional<YuvOfBgr> scaler_;
    cv::Mat colour_;  // of a grey image
    std::int64_t count_ = 0;
};

absl::Status LibavEncoder::open(double fps, VideoCodec codec) {
    format_.codec = codec;
    format_.fps = fps;
    const char* const library = codec == VideoCodec::kH264   ? "libx264"
                                : codec == VideoCodec::kFfv1 ? "ffv1"
                                                             : "utvideo";
    const AVCodec* const found = avcodec_find_encoder_by_name(library);
    if (!found) return failed(fmt::format("FFmpeg has no {}", library));
    if (codec == VideoCodec::kH264 && (format_.width % 2 || format_.height % 2))
        return absl::InvalidArgumentError(
            fmt::format("camera {}: H.264 needs even sides, its images are {} x {} px; record "
                        "with codec = \"utvideo\"",
                        camera_, format_.width, format_.height));
    encoder_.reset(avcodec_alloc_context3(found));
    const AVRational rate = av_d2q(fps, 100000);
    encoder_->width = format_.width;
    encoder_->height = format_.height;
    encoder_->time_base = av_inv_q(rate);
    encoder_->framerate = rate;
    encoder_->thread_count = 1;  // a thread a camera
    encoder_->log_level_offset = 64;
    encoder_->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
    encoder_->gop_size = key_distance(codec, fps);
    AVDictionary* options = nullptr;
    const auto set = [&options](const char* key, const char* value) { av_dict_set(&options, key, value, 0); };
    switch (codec) {
        case VideoCodec::kFfv1:  // of its ways the fastest; the range coder takes half as long again for a
                                 // tenth less
            encoder_->pix_fmt = AV_PIX_FMT_BGR0;
            encoder_->slices = 4;
            set("level", "3");
            set("coder", "rice");
            set("context", "0");
            set("slicecrc", "1");
            break;
        case VideoCodec::kUtVideo:
            encoder_->pix_fmt = AV_PIX_FMT_GBRP;
            set("pred", "median");
            break;
        case VideoCodec::kH264:  // keeps most of the sensor's noise
            encoder_->pix_fmt = AV_PIX_FMT_YUV420P;
            encoder_->max_b_frames = 0;
            encoder_->colorspace = AVCOL_SPC_SMPTE170M;
            encoder_->color_range = AVCOL_RANGE_MPEG;
            set("preset", "ultrafast");
            set("tune", "zerolatency");
            set("crf", "12");
            set("forced-idr", "1");
            break;
    }
    const int opened = avcodec_open2(encoder_.get(), found, &options);
    av_dict_free(&options);
    if (opened < 0) return failed(libav::reason(opened));
    format_.extra_data.assign(reinterpret_cast<const char*>(encoder_->extradata),
                              static_cast<std::size_t>(std::max(encoder_->extradata_size, 0)));
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    frame_->format = encoder_->pix_fmt;
    frame_->width = format_.width;
    frame_->height = format_.height;
    if (int e = av_frame_get_buffer(frame_.get(), 0); e < 0) return failed(libav::reason(e));
    const cv::Mat black(format_.height, format_.width, CV_8UC3, cv::Scalar::all(0));
    fill_frame({format_.width, format_.height, 3, {std::shared_ptr<const std::uint8_t[]>(), black.data}});
    return absl::OkStatus();
}

void LibavEncoder::fill_frame(const Image& image) {
    cv::Mat from = as_mat(image);
    if (image.channels == 1) {
        cv::cvtColor(from, colour_, cv::COLOR_GRAY2BGR);
        from = colour_;
    }
    const auto plane = [&](int p, int type) {
        return cv::Mat(format_.height, format_.width, type, frame_->data[p],
                       static_cast<std::size_t>(frame_->linesize[p]));
    };
    switch (format_.codec) {
        case VideoCodec::kFfv1: {
            cv::Mat to = plane(0, CV_8UC4);
            cv::cvtColor(from, to, cv::COLOR_BGR2BGRA);
            break;
        }
        case VideoCodec::kUtVideo: {
            std::array planes{plane(1, CV_8UC1), plane(0, CV_8UC1), plane(2, CV_8UC1)};  // of B, G, R
            cv::split(from, planes.data());
            break;
        }
        case VideoCodec::kH264: {
            if (!scaler_) scaler_.emplace(format_.width, format_.height);
            scaler_->convert(from.data, *frame_);
        }
    }
}

absl::StatusOr<std::shared_ptr<const EncodedImage>> LibavEncoder::encode(const Image& image, bool key) {
    const bool missing = image.empty();
    if (!missing && (image.width != format_.width || image.height != format_.height ||
                     (image.channels != 3 && image.channels != 1)))
        return absl::InvalidArgumentError(
            fmt::format("camera {}: an image of {} x {} px with {} channels, its calibration says {} x {}",
                        camera_, image.width, image.height, image.channels, format_.width, format_.height));
    if (int e = av_frame_make_writable(frame_.get()); e < 0) return failed(libav::reason(e));
    if (!missing) fill_frame(image);
    frame_->pts = count_++;
    frame_->pict_type = key ? AV_PICTURE_TYPE_I : AV_PICTURE_TYPE_NONE;
    if (int e = avcodec_send_frame(encoder_.get(), frame_.get()); e < 0) return failed(libav::reason(e));
    if (int e = avcodec_receive_packet(encoder_.get(), packet_.get()); e < 0) return failed(libav::reason(e));
    auto encoded = std::make_shared<EncodedImage>();
    encoded->bytes.assign(reinterpret_cast<const char*>(packet_->data),
                          static_cast<std::size_t>(packet_->size));
    encoded->key = packet_->flags & AV_PKT_FLAG_KEY;
    encoded->missing = missing;
    av_packet_unref(packet_.get());
    return encoded;
}

}  // namespace

std::string_view name_of(VideoCodec codec) {
    switch (codec) {
        case VideoCodec::kFfv1:
            return "ffv1";
        case VideoCodec::kUtVideo:
            return "utvideo";
        case VideoCodec::kH264:
            return "h264";
    }
    return "";
}

int key_distance(VideoCodec codec, double fps) {
    return codec == VideoCodec::kH264 ? std::max(1, static_cast<int>(fps / kKeysASecond)) : 1;
}

absl::StatusOr<std::unique_ptr<ImageEncoder>> ImageEncoder::create(const Camera& camera, double fps,
                                                                   VideoCodec codec) {
    auto encoder = std::make_unique<LibavEncoder>(camera);
    if (absl::Status opened = encoder->open(fps, codec); !opened.ok()) return opened;
    return encoder;
}

}  // namespace kinevox
