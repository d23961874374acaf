#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "server/cameras/image_pool.h"
#include "server/cameras/image_reader.h"
#include "server/cameras/libav.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

class IndexedVideo final : public RecordedVideo {
  public:
    IndexedVideo(fs::path file, const Camera& camera, std::vector<VideoIndexEntry> index)
        : file_(std::move(file)),
          camera_(camera),
          index_(std::move(index)),
          pool_(std::size_t{3} * camera.width * camera.height) {}
    ~IndexedVideo() override {
        if (descriptor_ >= 0) ::close(descriptor_);
    }

    absl::Status open();
    std::int64_t promised() const override { return size(); }
    bool promise_is_exact() const override { return true; }
    std::int64_t size() const override { return static_cast<std::int64_t>(index_.size()); }
    absl::StatusOr<Image> read(std::int64_t frame) override;
    absl::StatusOr<Image> next() override {
        if (at_ >= size()) return absl::OutOfRangeError("the video has ended");
        return read(at_);
    }
    absl::Status rewind() override {
        at_ = 0;
        return absl::OkStatus();
    }
    absl::Status seek(std::int64_t frame) override {
        if (frame < 0 || frame > size())
            return absl::OutOfRangeError(fmt::format("camera {}: frame {} is out of range; {} has {}",
                                                     camera_.name, frame, file_.string(), size()));
        at_ = frame;
        return absl::OkStatus();
    }

  private:
    absl::Status damaged(std::int64_t frame, const std::string& why) const {
        return absl::DataLossError(
            fmt::format("camera {}: image {} of {} cannot be decoded ({}): the file is damaged; copy "
                        "it again",
                        camera_.name, frame, file_.string(), why));
    }
    // Decodes one image into the decoder's frame.
    absl::Status decode(std::int64_t frame);
    absl::StatusOr<Image> image_of_frame(std::int64_t frame);

    fs::path file_;
    Camera camera_;
    std::vector<VideoIndexEntry> index_;
    ImagePool pool_;
    int descriptor_ = -1;
    libav::Owned<AVCodecContext> decoder_;
    libav::Owned<AVFrame> frame_;
    libav::Owned<AVPacket> packet_;
    libav::Owned<SwsContext> scaler_;
    std::int64_t at_ = 0;        // what next() delivers
    std::int64_t decoded_ = -1;  // last decoded; -1: the decoder has no state
};

absl::Status IndexedVideo::open() {
    AVFormatContext* opened = nullptr;
    // Reads only the header, which has all that the decoder needs.
    if (int e = avformat_open_input(&opened, file_.c_str(), nullptr, nullptr); e < 0)
        return absl::InvalidArgumentError(
            fmt::format("camera {}: {} cannot be read as a video ({}); copy it again", camera_.name,
                        file_.string(), libav::reason(e)));
    const libav::OwnedInput container(opened);
    if (container->nb_streams != 1 || container->streams[0]->codecpar->codec_type != AVMEDIA_TYPE_VIDEO)
        return absl::InvalidArgumentError(fmt::format("camera {}: {} is not a recorded video; copy it again",
                                                      camera_.name, file_.string()));
    const AVCodecParameters& parameters = *container->streams[0]->codecpar;
    if (parameters.width != camera_.width || parameters.height != camera_.height)
        return wrong_size(camera_, file_, parameters.width, parameters.height);
    const AVCodec* codec = avcodec_find_decoder(parameters.codec_id);
    decoder_.reset(avcodec_alloc_context3(codec));
    if (!codec || !decoder_ || avcodec_parameters_to_context(decoder_.get(), &parameters) < 0)
        return absl::InvalidArgumentError(fmt::format(
            "camera {}: {} has a codec that this FFmpeg cannot decode", camera_.name, file_.string()));
    decoder_->thread_count = 1;                  // the cameras are decoded in parallel
    decoder_->flags |= AV_CODEC_FLAG_LOW_DELAY;  // each image is output at once
    if (int e = avcodec_open2(decoder_.get(), codec, nullptr); e < 0)
        return absl::InvalidArgumentError(fmt::format("camera {}: {}: its decoder cannot be opened ({})",
                                                      camera_.name, file_.string(), libav::reason(e)));
    frame_.reset(av_frame_alloc());
    packet_.reset(av_packet_alloc());
    descriptor_ = ::open(file_.c_str(), O_RDONLY | O_CLOEXEC);
    if (descriptor_ < 0)
        return absl::InvalidArgumentError(fmt::format("camera {}: {} cannot be read: {}", camera_.name,
                                                      file_.string(), std::strerror(errno)));
    return absl::OkStatus();
}

absl::Status IndexedVideo::decode(std::int64_t frame) {
    decoded_ = -1;
    const VideoIndexEntry& entry = index_[static_cast<std::size_t>(frame)];
    av_packet_unref(packet_.get());
    if (av_new_packet(packet_.get(), static_cast<int>(entry.payload_bytes)) < 0)
        return damaged(frame, "it is too large");
    for (std::size_t done = 0; done < entry.payload_bytes;) {
        const ssize_t got = ::pread(descriptor_, packet_->data + done, entry.payload_bytes - done,
                                    static_cast<off_t>(entry.payload_offset + done));
        if (got < 0 && errno == EINTR) continue;
        if (got <= 0) return damaged(frame, got < 0 ? std::strerror(errno) : "the file was truncated");
        done += static_cast<std::size_t>(got);
    }
    if (entry.flags & VideoIndexEntry::kKey) {
        packet_->flags |= AV_PKT_FLAG_KEY;
        avcodec_flush_buffers(decoder_.get());
    }
    if (int e = avcodec_send_packet(decoder_.get(), packet_.get()); e < 0)
        return damaged(frame, libav::reason(e));
    if (int e = avcodec_receive_frame(decoder_.get(), frame_.get()); e < 0)
        return damaged(frame, libav::reason(e));
    if (frame_->width != camera_.width || frame_->height != camera_.height)
        return damaged(frame, fmt::format("it is {} x {} px", frame_->width, frame_->height));
    decoded_ = frame;
    return absl::OkStatus();
}

absl::StatusOr<Image> IndexedVideo::image_of_frame(std::int64_t frame) {
    const int width = camera_.width, height = camera_.height;
    auto data = pool_.take();
    cv::Mat out(height, width, CV_8UC3, data.get());
    const auto plane = [&](int p, int type) {
        return cv::Mat(height, width, type, frame_->data[p], static_cast<std::size_t>(frame_->linesize[p]));
    };
    switch (frame_->format) {
        case AV_PIX_FMT_BGR0:
        case AV_PIX_FMT_BGRA:
            cv::cvtColor(plane(0, CV_8UC4), out, cv::COLOR_BGRA2BGR);
            break;
        case AV_PIX_FMT_GBRP: {
            const std::array planes{plane(1, CV_8UC1), plane(0, CV_8UC1), plane(2, CV_8UC1)};
            cv::merge(planes.data(), planes.size(), out);
            break;
        }
        case AV_PIX_FMT_GRAY8:
            cv::cvtColor(plane(0, CV_8UC1), out, cv::COLOR_GRAY2BGR);
            break;
        default: {
            if (!scaler_)
                scaler_.reset(sws_getContext(width, height, static_cast<AVPixelFormat>(frame_->format), width,
                                             height, AV_PIX_FMT_BGR24,
                                             SWS_BICUBIC | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INT, nullptr,
                                             nullptr, nullptr));
            if (!scaler_) return damaged(frame, "its pixel format is not supported");
            std::uint8_t* const planes[1] = {data.get()};
            const int strides[1] = {3 * width};
            sws_scale(scaler_.get(), frame_->data, frame_->linesize, 0, height, planes, strides);
        }
    }
    return Image{width, height, 3, std::move(data)};
}

absl::StatusOr<Image> IndexedVideo::read(std::int64_t frame) {
    if (frame < 0 || frame >= size())
        return absl::OutOfRangeError(fmt::format("camera {}: frame {} is out of range; {} has {}",
                                                 camera_.name, frame, file_.string(), size()));
    at_ = frame + 1;
    const auto key = [&](std::int64_t f) {
        return index_[static_cast<std::size_t>(f)].flags & VideoIndexEntry::kKey;
    };
    std::int64_t first = frame;
    while (first > 0 && !key(first) && first - 1 != decoded_) --first;
    for (std::int64_t f = first; f <= frame; ++f)
        if (absl::Status decoded = decode(f); !decoded.ok()) return decoded;
    if (index_[static_cast<std::size_t>(frame)].flags & VideoIndexEntry::kMissing) return Image{};
    return image_of_frame(frame);
}

}  // namespace

bool RecordedVideo::is_one(const fs::path& video) {
    std::error_code error;
    return video.extension() == ".mkv" && fs::is_regular_file(video_index_file(video), error);
}

absl::StatusOr<std::unique_ptr<RecordedVideo>> RecordedVideo::open(const fs::path& video,
                                                                   const Camera& camera,
                                                                   std::int64_t max_frames) {
    auto index = read_video_index(video);
    if (!index.ok())
        return absl::Status(index.status().code(),
                            fmt::format("camera {}: {}", camera.name, std::string(index.status().message())));
    if (max_frames >= 0 && static_cast<std::int64_t>(index->size()) > max_frames)
        index->resize(static_cast<std::size_t>(max_frames));
    auto opened = std::make_unique<IndexedVideo>(video, camera, *std::move(index));
    if (absl::Status status = opened->open(); !status.ok()) return status;
    return opened;
}

}  // namespace kinevox
