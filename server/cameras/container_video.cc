#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <opencv2/core.hpp>
#include <thread>
#include <utility>
#include <vector>

#include "server/cameras/image_pool.h"
#include "server/cameras/image_reader.h"
#include "server/cameras/libav.h"
#include "server/cameras/video_packets.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

// Within this distance frames are decoded in sequence instead of seeking; as many are cached before a seek.
constexpr std::int64_t kNear = 8;
constexpr std::size_t kReordered = 17;  // exceeds the reordering depth of all codecs, packets
constexpr std::size_t kKeptBytes = std::size_t{32} << 20, kMaxKept = 48;
constexpr unsigned kMaxThreads = 4;  // per decoder; the cameras are decoded in parallel

// Whether an image's memory has this many rows; with block-based codecs these exceed the visible ones.
bool has_rows(const AVFrame& frame, int rows) {
    const AVPixFmtDescriptor* const format = av_pix_fmt_desc_get(static_cast<AVPixelFormat>(frame.format));
    for (int p = 0; format && p < av_pix_fmt_count_planes(static_cast<AVPixelFormat>(frame.format)); ++p) {
        const AVBufferRef* const buffer = av_frame_get_plane_buffer(const_cast<AVFrame*>(&frame), p);
        const int of_plane = p == 1 || p == 2 ? AV_CEIL_RSHIFT(rows, format->log2_chroma_h) : rows;
        if (!buffer || frame.linesize[p] <= 0 ||
            frame.data[p] + static_cast<std::ptrdiff_t>(of_plane) * frame.linesize[p] >
                buffer->data + buffer->size)
            return false;
    }
    return format != nullptr;
}

class ContainerVideo final : public ImageReader {
  public:
    ContainerVideo(fs::path file, const Camera& camera, std::unique_ptr<VideoPackets> packets)
        : file_(std::move(file)),
          camera_(camera),
          whose_("camera " + camera.name),
          packets_(std::move(packets)),
          pool_(std::size_t{3} * camera.width * camera.height) {}

    absl::Status open();

    std::int64_t promised() const override { return packets_->promised(); }
    bool promise_is_exact() const override { return packets_->promise_is_exact(); }
    absl::StatusOr<std::int64_t> count() override;
    absl::StatusOr<Image> next() override;
    absl::Status seek(std::int64_t frame) override;
    absl::Status rewind() override {
        at_ = 0;
        return absl::OkStatus();
    }

  private:
    using Frame = libav::Owned<AVFrame>;
    struct Kept {
        std::int64_t image = 0;
        Frame frame;
    };

    absl::Status check_size(int width, int height) const;  // coded size
    absl::Status ended(std::int64_t after) const;
    absl::StatusOr<Frame> decode();  // the next visible one; null: end
    const AVFrame* kept(std::int64_t image) const;
    const AVFrame& keep(std::int64_t image, Frame frame);
    absl::Status load(std::int64_t image);  // into kept_
    absl::Status decode_on_to(std::int64_t image);
    absl::StatusOr<bool> load_from_key(std::int64_t image);
    absl::StatusOr<bool> read_from(const KeyPacket& key, std::size_t min_packets,
                                   std::vector<std::int64_t>& times);
    absl::Status restart();
    absl::StatusOr<Image> image_of(const AVFrame& frame);

    const fs::path file_;
    const Camera camera_;
    const std::string whose_;
    const std::unique_ptr<VideoPackets> packets_;
    ImagePool pool_;
    int rotation_deg_ = 0;  // clockwise, of the coded images
    libav::Owned<AVCodecContext> decoder_;
    libav::Owned<AVPacket> packet_;
    libav::Owned<SwsContext> scaler_;
    Frame bgr_;  // of the coded size

    std::int64_t at_ = 0;                        // what next() delivers
    std::int64_t decoded_ = 0;                   // what decode() delivers; -1: unknown
    std::deque<libav::Owned<AVPacket>> read_;    // for the decoder, before those of packets_
    std::int64_t skip_before_ = AV_NOPTS_VALUE;  // earlier images may be skipped if no other references them
    // Whether the first visible image was the first one read. If not, some before it could not be decoded, so
    // that numbers from counting packets would be wrong.
    enum class Start { kUnknown, kComplete, kTruncated } start_ = Start::kUnknown;
    std::int64_t earliest_ =
        std::numeric_limits<std::int64_t>::max();  // of the packets' timestamps since restart()
    bool sought_ = false;
    std::size_t max_kept_ = 1;  // after the first seek
    std::deque<Kept> kept_;     // oldest first
};

absl::Status ContainerVideo::check_size(int width, int height) const {
    if (rotation_deg_ % 180 != 0) std::swap(width, height);
    if (width == camera_.width && height == camera_.height) return absl::OkStatus();
    return wrong_size(camera_, file_, width, height);
}

absl::Status ContainerVideo::open() {
    const AVCodecParameters& parameters = packets_->parameters();
    rotation_deg_ = packets_->rotation_deg();
    if (absl::Status fits = check_size(parameters.width, parameters.height); !fits.ok()) return fits;
    decoder_.reset(avcodec_alloc_context3(packets_->decoder()));
    packet_.reset(av_packet_alloc());
    if (!decoder_ || !packet_ || avcodec_parameters_to_context(decoder_.get(), &parameters) < 0)
        return absl::ResourceExhaustedError(
            fmt::format("{}: no memory for a decoder of {}", whose_, file_.string()));
    decoder_->thread_count =
        static_cast<int>(std::clamp(std::thread::hardware_concurrency(), 1U, kMaxThreads));
    if (int e = avcodec_open2(decoder_.get(), packets_->decoder(), nullptr); e < 0)
        return absl::InvalidArgumentError(
            fmt::format("{}: {}: its decoder cannot be opened ({}); convert it with ffmpeg", whose_,
                        file_.string(), libav::reason(e)));
    return absl::OkStatus();
}

absl::StatusOr<std::int64_t> ContainerVideo::count() {
    if (promise_is_exact()) return promised();
    if (const auto indexed = packets_->index(); !indexed.ok()) return indexed.status();
    return packets_->images();
}

absl::Status ContainerVideo::ended(std::int64_t after) const {
    if (promise_is_exact() && 0 < after && after < promised())
        return absl::DataLossError(fmt::format(
            "{}: {} ends after {} of {} frames: it is damaged or truncated; copy it again or trim all "
            "videos of the session to {} frames",
            whose_, file_.string(), after, promised(), after));
    if (after == 0)
        return absl::DataLossError(
            fmt::format("{}: no frame of {} can be decoded: it is empty, damaged or of an unknown format; "
                        "copy it again or convert it with ffmpeg",
                        whose_, file_.string()));
    return absl::OutOfRangeError("the video has ended");
}

absl::StatusOr<ContainerVideo::Frame> ContainerVideo::decode() {
    Frame frame(av_frame_alloc());
    for (;;) {
        int error = avcodec_receive_frame(decoder_.get(), frame.get());
        if (error == AVERROR_EOF) return Frame();
        if (error == 0) {
            if (absl::Status fits = check_size(frame->width, frame->height); !fits.ok()) return fits;
            return frame;
        }
        if (error == AVERROR(EAGAIN)) {
            error = 0;
            if (!read_.empty()) {
                packet_ = std::move(read_.front());
                read_.pop_front();
            } else {
                error = packets_->next(packet_.get());  // an unreadable remainder counts as the end
            }
            const bool wanted = error < 0 || packet_->pts == AV_NOPTS_VALUE || packet_->pts >= skip_before_;
            decoder_->skip_frame = wanted ? AVDISCARD_DEFAULT : AVDISCARD_NONREF;
            if (error == 0 && packet_->pts != AV_NOPTS_VALUE && !(packet_->flags & AV_PKT_FLAG_DISCARD))
                earliest_ = std::min(earliest_, packet_->pts);
            error = avcodec_send_packet(decoder_.get(), error < 0 ? nullptr : packet_.get());
        }
        // Errors before the first image may stem from a trimmed start.
        if (error < 0 && error != AVERROR_EOF && decoded_ != 0)
            return absl::DataLossError(
                fmt::format("{}: only {} of {} frames of {} can be decoded ({}): it is damaged or truncated; "
                            "copy it again",
                            whose_, decoded_, promised(), file_.string(), libav::reason(error)));
    }
}

const AVFrame* ContainerVideo::kept(std::int64_t image) const {
    const auto found = std::ranges::find(kept_, image, &Kept::image);
    return found == kept_.end() ? nullptr : found->frame.get();
}

const AVFrame& ContainerVideo::keep(std::int64_t image, Frame frame) {
    if (const AVFrame* const there = kept(image)) return *there;
    while (kept_.size() >= (sought_ ? max_kept_ : 1)) kept_.pop_front();
    kept_.push_back({image, std::move(frame)});
    return *kept_.back().frame;
}

absl::Status ContainerVideo::restart() {
    read_.clear();
    skip_before_ = AV_NOPTS_VALUE;
    earliest_ = std::numeric_limits<std::int64_t>::max();
    avcodec_flush_buffers(decoder_.get());
    decoded_ = 0;
    return packets_->restart();
}

absl::Status ContainerVideo::decode_on_to(std::int64_t image) {
    while (decoded_ <= image) {
        auto frame = decode();
        if (!frame.ok()) return frame.status();
        if (!*frame) return ended(decoded_);
        if (decoded_ == 0)
            start_ = (*frame)->pts == AV_NOPTS_VALUE || (*frame)->pts > earliest_ ? Start::kTruncated
                                                                                  : Start::kComplete;
        keep(decoded_++, *std::move(frame));
    }
    return absl::OkStatus();
}

// Reads at least `min_packets` packets from the key on, if available, and returns the presentation times of
// the visible ones. False if one has no time.
absl::StatusOr<bool> ContainerVideo::read_from(const KeyPacket& key, std::size_t min_packets,
                                               std::vector<std::int64_t>& times) {
    read_.clear();
    decoded_ = -1;
    if (absl::Status there = packets_->go_to(key); !there.ok()) return there;
    avcodec_flush_buffers(decoder_.get());
    while (times.size() < min_packets) {
        libav::Owned<AVPacket> packet(av_packet_alloc());
        if (packets_->next(packet.get()) < 0) break;
        if (packet->pts == AV_NOPTS_VALUE) return false;
        if (!(packet->flags & AV_PKT_FLAG_DISCARD)) times.push_back(packet->pts);
        read_.push_back(std::move(packet));
    }
    return !read_.empty();
}

// False if the position cannot be determined exactly.
absl::StatusOr<bool> ContainerVideo::load_from_key(std::int64_t image) {
    const std::vector<KeyPacket>& keys = packets_->keys();
    auto key = std::ranges::upper_bound(keys, image, {}, &KeyPacket::images_before);
    while (key != keys.begin()) {
        --key;
        auto wanted = static_cast<std::size_t>(image - key->images_before);
        std::vector<std::int64_t> times;
        const auto read = read_from(*key, wanted + kReordered + 1, times);
        if (!read.ok() || !*read) return read;
        const std::int64_t of_key = read_.front()->pts;
        std::ranges::sort(times);
        if (std::ranges::adjacent_find(times) != times.end()) return false;
        if (wanted >= times.size())
            return ended(key->images_before + static_cast<std::int64_t>(times.size()));
        // Images that follow the key but precede it in presentation order may reference earlier ones.
        const auto leading =
            static_cast<std::size_t>(std::ranges::lower_bound(times, of_key) - times.begin());
        if (wanted < leading) continue;
        const std::size_t first = std::max(leading, wanted - std::min<std::size_t>(wanted, kNear - 1));
        skip_before_ = packets_->parameters().codec_id == AV_CODEC_ID_H264 ? times[first] : AV_NOPTS_VALUE;
        for (;;) {
            auto frame = decode();
            if (!frame.ok() || !*frame) return false;
            const std::int64_t time = (*frame)->pts;
            if (time == AV_NOPTS_VALUE || time > times[wanted]) return false;  // the wanted image is missing
            if (time < times[first]) continue;
            const auto n = std::ranges::lower_bound(times, time) - times.begin();
            keep(key->images_before + n, *std::move(frame));
            if (time < times[wanted]) continue;
            decoded_ = image + 1;
            return true;
        }
    }
    return false;
}

absl::Status ContainerVideo::load(std::int64_t image) {
    const auto decodes_before = [&] { return decoded_ >= 0 && decoded_ <= image; };
    if (start_ == Start::kUnknown) {
        if (decoded_ != 0)
            if (absl::Status begun = restart(); !begun.ok()) return begun;
        if (absl::Status first = decode_on_to(0); !first.ok()) return first;
    }
    if (decodes_before() && image - decoded_ <= kNear) return decode_on_to(image);
    if (image > 0 && start_ == Start::kComplete) {
        const auto indexed = packets_->index();
        if (!indexed.ok()) return indexed.status();
        if (*indexed) {
            const auto loaded = load_from_key(image);
            if (!loaded.ok() || *loaded) return loaded.status();
        }
    }
    if (!decodes_before())
        if (absl::Status begun = restart(); !begun.ok()) return begun;
    return decode_on_to(image);
}

absl::Status ContainerVideo::seek(std::int64_t frame) {
    if (frame < 0 || (promise_is_exact() && frame >= promised()))
        return absl::OutOfRangeError(fmt::format("{}: frame {} is out of range; {} has {}", whose_, frame,
                                                 file_.string(), promised()));
    if (!sought_) {
        const std::size_t bytes =
            std::size_t{2} * camera_.width * camera_.height;  // approximate, per cached image
        max_kept_ = std::clamp<std::size_t>(kKeptBytes / std::max<std::size_t>(bytes, 1), 1, kMaxKept);
        sought_ = true;
    }
    at_ = frame;
    return absl::OkStatus();
}

absl::StatusOr<Image> ContainerVideo::next() {
    const AVFrame* frame = kept(at_);
    if (!frame) {
        if (absl::Status there = load(at_); !there.ok()) {
            if (!absl::IsOutOfRange(there)) decoded_ = -1;
            return there;
        }
        frame = kept(at_);
    }
    auto image = image_of(*frame);
    if (image.ok()) ++at_;
    return image;
}

// Converts to B G R bit for bit as OpenCV does, but rotates as video players do (OpenCV 4.6 rotates the wrong
// way).
absl::StatusOr<Image> ContainerVideo::image_of(const AVFrame& frame) {
    int width = std::max(decoder_->coded_width, frame.width),
        height = std::max(decoder_->coded_height, frame.height);
    if (!has_rows(frame, height)) width = frame.width, height = frame.height;
    scaler_.reset(sws_getCachedContext(scaler_.release(), width, height,
                                       static_cast<AVPixelFormat>(frame.format), width, height,
                                       AV_PIX_FMT_BGR24, SWS_BICUBIC, nullptr, nullptr, nullptr));
    if (!scaler_)
        return absl::InvalidArgumentError(fmt::format(
            "{}: the pixel format of {} is not supported; convert it with ffmpeg", whose_, file_.string()));
    if (!bgr_ || bgr_->width != width || bgr_->height != height) {
        bgr_.reset(av_frame_alloc());
        bgr_->format = AV_PIX_FMT_BGR24, bgr_->width = width, bgr_->height = height;
        if (av_frame_get_buffer(bgr_.get(), 32) < 0)
            return absl::ResourceExhaustedError(
                fmt::format("{}: no memory for an image of {}", whose_, file_.string()));
    }
    sws_scale(scaler_.get(), frame.data, frame.linesize, 0, height, bgr_->data, bgr_->linesize);
    auto data = pool_.take();
    const cv::Mat shown(frame.height, frame.width, CV_8UC3, bgr_->data[0],
                        static_cast<std::size_t>(bgr_->linesize[0]));
    cv::Mat out(camera_.height, camera_.width, CV_8UC3, data.get());
    switch (rotation_deg_) {
        case 90:
            cv::rotate(shown, out, cv::ROTATE_90_CLOCKWISE);
            break;
        case 180:
            cv::rotate(shown, out, cv::ROTATE_180);
            break;
        case 270:
            cv::rotate(shown, out, cv::ROTATE_90_COUNTERCLOCKWISE);
            break;
        default:
            shown.copyTo(out);
    }
    return Image{camera_.width, camera_.height, 3, std::move(data)};
}

}  // namespace

absl::StatusOr<std::unique_ptr<ImageReader>> open_container_video(const fs::path& file,
                                                                  const Camera& camera) {
    auto packets = VideoPackets::open(file, "camera " + camera.name);
    if (!packets.ok()) return packets.status();
    auto video = std::make_unique<ContainerVideo>(file, camera, *std::move(packets));
    if (absl::Status opened = video->open(); !opened.ok()) return opened;
    return video;
}

}  // namespace kinevox
