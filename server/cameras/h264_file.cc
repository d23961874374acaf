#include "server/cameras/h264_file.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

#include "server/cameras/libav.h"

namespace kinevox {
namespace {

using libav::Owned;
using libav::reason;

class LibavFile final : public H264File {
  public:
    explicit LibavFile(const std::filesystem::path& file) : file_(file.string()) {}
    ~LibavFile() override { (void)close(); }

    absl::Status open(int width, int height, const H264Options& options) {
        const AVCodec* codec = avcodec_find_encoder_by_name("libx264");
        if (!codec)
            return absl::UnavailableError(
                fmt::format("{}: libavcodec has no libx264; install libavcodec-extra", file_));
        encoder_.reset(avcodec_alloc_context3(codec));
        const AVRational rate = av_d2q(options.fps, 100000);
        encoder_->width = width;
        encoder_->height = height;
        encoder_->time_base = av_inv_q(rate);
        encoder_->framerate = rate;
        encoder_->pix_fmt = AV_PIX_FMT_YUV420P;
        encoder_->gop_size = 30;
        encoder_->max_b_frames = 0;
        encoder_->thread_count =
            1;  // cameras are encoded in parallel; the bits must not depend on the thread count
        encoder_->colorspace = AVCOL_SPC_SMPTE170M;
        encoder_->color_range = AVCOL_RANGE_MPEG;
        av_opt_set(encoder_->priv_data, "preset", "veryfast", 0);
        av_opt_set(encoder_->priv_data, "tune", "grain", 0);
        av_opt_set_double(encoder_->priv_data, "crf", options.crf, 0);
        encoder_->log_level_offset = 64;  // silences x264; errors are returned as codes

        AVFormatContext* container = nullptr;
        if (int e = avformat_alloc_output_context2(&container, nullptr, "mp4", file_.c_str()); e < 0)
            return failed("begin", e);
        container_.reset(container);
        if (container_->oformat->flags & AVFMT_GLOBALHEADER) encoder_->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
        if (int e = avcodec_open2(encoder_.get(), codec, nullptr); e < 0)
            return failed("open the encoder for", e);
        stream_ = avformat_new_stream(container_.get(), nullptr);
        stream_->time_base = encoder_->time_base;
        stream_->avg_frame_rate = rate;
        if (int e = avcodec_parameters_from_context(stream_->codecpar, encoder_.get()); e < 0)
            return failed("begin", e);
        if (int e = avio_open(&container_->pb, file_.c_str(), AVIO_FLAG_WRITE); e < 0)
            return failed("create", e);
        if (int e = avformat_write_header(container_.get(), nullptr); e < 0) return failed("begin", e);
        frame_.reset(av_frame_alloc());
        frame_->format = encoder_->pix_fmt;
        frame_->width = width;
        frame_->height = height;
        if (int e = av_frame_get_buffer(frame_.get(), 0); e < 0) return failed("begin", e);
        packet_.reset(av_packet_alloc());
        scaler_.emplace(width, height);
        open_ = true;
        return absl::OkStatus();
    }

    absl::Status write(const Image& image) override {
        if (image.width != frame_->width || image.height != frame_->height || image.channels != 3)
            return absl::InvalidArgumentError(
                fmt::format("{}: an image of {} x {} px with {} channels does not match the video", file_,
                            image.width, image.height, image.channels));
        if (int e = av_frame_make_writable(frame_.get()); e < 0) return failed("write", e);
        scaler_->convert(image.data.get(), *frame_);
        frame_->pts = count_++;
        return encode(frame_.get());
    }

    absl::Status close() override {
        if (!open_) return absl::OkStatus();
        open_ = false;
        if (absl::Status status = encode(nullptr); !status.ok()) return status;
        if (int e = av_write_trailer(container_.get()); e < 0) return failed("finish", e);
        if (int e = avio_closep(&container_->pb); e < 0) return failed("close", e);
        return absl::OkStatus();
    }

  private:
    absl::Status failed(std::string_view what, int error) const {
        return absl::UnavailableError(fmt::format("{}: cannot {} the video: {}", file_, what, reason(error)));
    }
    absl::Status encode(const AVFrame* frame) {
        if (int e = avcodec_send_frame(encoder_.get(), frame); e < 0) return failed("encode", e);
        for (;;) {
            const int e = avcodec_receive_packet(encoder_.get(), packet_.get());
            if (e == AVERROR(EAGAIN) || e == AVERROR_EOF) return absl::OkStatus();
            if (e < 0) return failed("encode", e);
            packet_->duration = 1;
            av_packet_rescale_ts(packet_.get(), encoder_->time_base, stream_->time_base);
            packet_->stream_index = stream_->index;
            if (int w = av_interleaved_write_frame(container_.get(), packet_.get()); w < 0)
                return failed("write", w);
        }
    }

    std::string file_;
    Owned<AVFormatContext> container_;
    Owned<AVCodecContext> encoder_;
    Owned<AVFrame> frame_;
    Owned<AVPacket> packet_;
    std::optional<YuvOfBgr> scaler_;
    AVStream* stream_ = nullptr;
    std::int64_t count_ = 0;
    bool open_ = false;
};

}  // namespace

absl::StatusOr<std::unique_ptr<H264File>> H264File::create(const std::filesystem::path& file, int width,
                                                           int height, const H264Options& options) {
    if (width % 2 || height % 2)
        return absl::InvalidArgumentError(fmt::format("{}: H.264 needs an even width and height, not {} x {}",
                                                      file.string(), width, height));
    auto video = std::make_unique<LibavFile>(file);
    if (absl::Status status = video->open(width, height, options); !status.ok()) return status;
    return video;
}

}  // namespace kinevox
