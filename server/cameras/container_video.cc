#include "server/cameras/container_video.h"

#include <fmt/format.h>

#include <algorithm>
#include <deque>
#include <limits>
#include <opencv2/core.hpp>
#include <thread>
#include <utility>
#include <vector>

#include "server/cameras/libav.h"
#include "server/cameras/picture_pool.h"
#include "server/cameras/video_packets.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kNear = 8;  // so few are decoded rather than looked for, or kept before one sought
constexpr std::size_t kReordered = 17;  // no codec shows a packet's picture so many packets later
constexpr std::size_t kKeptBytes = std::size_t{32} << 20, kMaxKept = 48;
constexpr unsigned kMaxThreads = 4;  // of one decoder; the cameras are decoded beside each other

// Whether a picture's memory has so many rows, which are more than are shown where the codec works in blocks.
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

class ContainerVideo final : public PictureReader {
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
    absl::StatusOr<Picture> next() override;
    absl::Status seek(std::int64_t frame) override;
    absl::Status rewind() override {
        at_ = 0;
        return absl::OkStatus();
    }

  private:
    using Frame = libav::Owned<AVFrame>;
    struct Kept {
        std::int64_t picture = 0;
        Frame frame;
    };

    absl::Status check_size(int width, int height) const;  // as they are coded
    absl::Status ended(std::int64_t after) const;
    absl::StatusOr<Frame> decode();  // the next one that is shown; null: there is none
    const AVFrame* kept(std::int64_t picture) const;
    const AVFrame& keep(std::int64_t picture, Frame frame);
    absl::Status bring(std::int64_t picture);  // into kept_
    absl::Status decode_on_to(std::int64_t picture);
    absl::StatusOr<bool> bring_from_key(std::int64_t picture);
    absl::StatusOr<bool> read_from(const KeyPacket& key, std::size_t most, std::vector<std::int64_t>& times);
    absl::Status restart();
    absl::StatusOr<Picture> picture_of(const AVFrame& frame);

    const fs::path file_;
    const Camera camera_;
    const std::string whose_;
    const std::unique_ptr<VideoPackets> packets_;
    PicturePool pool_;
    int turn_deg_ = 0;  // clockwise, of the coded pictures
    libav::Owned<AVCodecContext> decoder_;
    libav::Owned<AVPacket> packet_;
    libav::Owned<SwsContext> scaler_;
    Frame bgr_;  // of the coded size

    std::int64_t at_ = 0;                      // what next() delivers
    std::int64_t decoded_ = 0;                 // what decode() delivers; -1: unknown
    std::deque<libav::Owned<AVPacket>> read_;  // for the decoder, before what packets_ has
    std::int64_t skip_before_ =
        AV_NOPTS_VALUE;  // pictures shown earlier need not come, if no other needs them
    // Whether the first picture shown was the first that was read. Else some before it could not be decoded,
    // so that numbers found by counting packets would be other ones.
    enum class Begin { kUnseen, kWhole, kTorn } begin_ = Begin::kUnseen;
    std::int64_t earliest_ =
        std::numeric_limits<std::int64_t>::max();  // of the packets' times since restart()
    bool sought_ = false;
    std::size_t max_kept_ = 1;  // once it was sought in
    std::deque<Kept> kept_;     // oldest first
};

absl::Status ContainerVideo::check_size(int width, int height) const {
    if (turn_deg_ % 180 != 0) std::swap(width, height);
    if (width == camera_.width && height == camera_.height) return absl::OkStatus();
    return wrong_size(camera_, file_, width, height);
}

absl::Status ContainerVideo::open() {
    const AVCodecParameters& parameters = packets_->parameters();
    turn_deg_ = packets_->turn_deg();
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
    return packets_->pictures();
}

absl::Status ContainerVideo::ended(std::int64_t after) const {
    if (promise_is_exact() && 0 < after && after < promised())
        return absl::DataLossError(
            fmt::format("{}: {} breaks off after {} of {} frames: it is damaged or cut off; copy it again or "
                        "shorten all of the "
                        "session's videos to {} frames",
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
                error = packets_->next(packet_.get());  // an unreadable rest is the end
            }
            const bool wanted = error < 0 || packet_->pts == AV_NOPTS_VALUE || packet_->pts >= skip_before_;
            decoder_->skip_frame = wanted ? AVDISCARD_DEFAULT : AVDISCARD_NONREF;
            if (error == 0 && packet_->pts != AV_NOPTS_VALUE && !(packet_->flags & AV_PKT_FLAG_DISCARD))
                earliest_ = std::min(earliest_, packet_->pts);
            error = avcodec_send_packet(decoder_.get(), error < 0 ? nullptr : packet_.get());
        }
        // What comes before the first picture may be the rest of something that was cut.
        if (error < 0 && error != AVERROR_EOF && decoded_ != 0)
            return absl::DataLossError(
                fmt::format("{}: only {} of {} frames of {} can be decoded ({}): it is damaged or cut off; "
                            "copy it again",
                            whose_, decoded_, promised(), file_.string(), libav::reason(error)));
    }
}

const AVFrame* ContainerVideo::kept(std::int64_t picture) const {
    const auto found = std::ranges::find(kept_, picture, &Kept::picture);
    return found == kept_.end() ? nullptr : found->frame.get();
}

const AVFrame& ContainerVideo::keep(std::int64_t picture, Frame frame) {
    if (const AVFrame* const there = kept(picture)) return *there;
    while (kept_.size() >= (sought_ ? max_kept_ : 1)) kept_.pop_front();
    kept_.push_back({picture, std::move(frame)});
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

absl::Status ContainerVideo::decode_on_to(std::int64_t picture) {
    while (decoded_ <= picture) {
        auto frame = decode();
        if (!frame.ok()) return frame.status();
        if (!*frame) return ended(decoded_);
        if (decoded_ == 0)
            begin_ =
                (*frame)->pts == AV_NOPTS_VALUE || (*frame)->pts > earliest_ ? Begin::kTorn : Begin::kWhole;
        keep(decoded_++, *std::move(frame));
    }
    return absl::OkStatus();
}

// Reads at least `most` packets from the key on, as far as there are, and tells when those that are shown are
// shown. False where that is not known of each.
absl::StatusOr<bool> ContainerVideo::read_from(const KeyPacket& key, std::size_t most,
                                               std::vector<std::int64_t>& times) {
    read_.clear();
    decoded_ = -1;
    if (absl::Status there = packets_->go_to(key); !there.ok()) return there;
    avcodec_flush_buffers(decoder_.get());
    while (times.size() < most) {
        libav::Owned<AVPacket> packet(av_packet_alloc());
        if (packets_->next(packet.get()) < 0) break;
        if (packet->pts == AV_NOPTS_VALUE) return false;
        if (!(packet->flags & AV_PKT_FLAG_DISCARD)) times.push_back(packet->pts);
        read_.push_back(std::move(packet));
    }
    return !read_.empty();
}

// False where it cannot be told exactly.
absl::StatusOr<bool> ContainerVideo::bring_from_key(std::int64_t picture) {
    const std::vector<KeyPacket>& keys = packets_->keys();
    auto key = std::ranges::upper_bound(keys, picture, {}, &KeyPacket::pictures_before);
    while (key != keys.begin()) {
        --key;
        auto wanted = static_cast<std::size_t>(picture - key->pictures_before);
        std::vector<std::int64_t> times;
        const auto read = read_from(*key, wanted + kReordered + 1, times);
        if (!read.ok() || !*read) return read;
        const std::int64_t of_key = read_.front()->pts;
        std::ranges::sort(times);
        if (std::ranges::adjacent_find(times) != times.end()) return false;
        if (wanted >= times.size())
            return ended(key->pictures_before + static_cast<std::int64_t>(times.size()));
        // Pictures that are shown before the key though they follow it may need what came before it.
        const auto leading =
            static_cast<std::size_t>(std::ranges::lower_bound(times, of_key) - times.begin());
        if (wanted < leading) continue;
        const std::size_t first = std::max(leading, wanted - std::min<std::size_t>(wanted, kNear - 1));
        skip_before_ = packets_->parameters().codec_id == AV_CODEC_ID_H264 ? times[first] : AV_NOPTS_VALUE;
        for (;;) {
            auto frame = decode();
            if (!frame.ok() || !*frame) return false;
            const std::int64_t time = (*frame)->pts;
            if (time == AV_NOPTS_VALUE || time > times[wanted]) return false;  // the wanted one did not come
            if (time < times[first]) continue;
            const auto n = std::ranges::lower_bound(times, time) - times.begin();
            keep(key->pictures_before + n, *std::move(frame));
            if (time < times[wanted]) continue;
            decoded_ = picture + 1;
            return true;
        }
    }
    return false;
}

absl::Status ContainerVideo::bring(std::int64_t picture) {
    const auto decodes_before = [&] { return decoded_ >= 0 && decoded_ <= picture; };
    if (begin_ == Begin::kUnseen) {
        if (decoded_ != 0)
            if (absl::Status begun = restart(); !begun.ok()) return begun;
        if (absl::Status first = decode_on_to(0); !first.ok()) return first;
    }
    if (decodes_before() && picture - decoded_ <= kNear) return decode_on_to(picture);
    if (picture > 0 && begin_ == Begin::kWhole) {
        const auto indexed = packets_->index();
        if (!indexed.ok()) return indexed.status();
        if (*indexed) {
            const auto brought = bring_from_key(picture);
            if (!brought.ok() || *brought) return brought.status();
        }
    }
    if (!decodes_before())
        if (absl::Status begun = restart(); !begun.ok()) return begun;
    return decode_on_to(picture);
}

absl::Status ContainerVideo::seek(std::int64_t frame) {
    if (frame < 0 || (promise_is_exact() && frame >= promised()))
        return absl::OutOfRangeError(
            fmt::format("{}: frame {} is not one of {}'s {}", whose_, frame, file_.string(), promised()));
    if (!sought_) {
        const std::size_t bytes = std::size_t{2} * camera_.width * camera_.height;  // of one kept, about
        max_kept_ = std::clamp<std::size_t>(kKeptBytes / std::max<std::size_t>(bytes, 1), 1, kMaxKept);
        sought_ = true;
    }
    at_ = frame;
    return absl::OkStatus();
}

absl::StatusOr<Picture> ContainerVideo::next() {
    const AVFrame* frame = kept(at_);
    if (!frame) {
        if (absl::Status there = bring(at_); !there.ok()) {
            if (!absl::IsOutOfRange(there)) decoded_ = -1;
            return there;
        }
        frame = kept(at_);
    }
    auto picture = picture_of(*frame);
    if (picture.ok()) ++at_;
    return picture;
}

// As OpenCV makes B G R of a video, bit for bit; but turned as players turn it, which OpenCV 4.6 does the
// wrong way.
absl::StatusOr<Picture> ContainerVideo::picture_of(const AVFrame& frame) {
    int width = std::max(decoder_->coded_width, frame.width),
        height = std::max(decoder_->coded_height, frame.height);
    if (!has_rows(frame, height)) width = frame.width, height = frame.height;
    scaler_.reset(sws_getCachedContext(scaler_.release(), width, height,
                                       static_cast<AVPixelFormat>(frame.format), width, height,
                                       AV_PIX_FMT_BGR24, SWS_BICUBIC, nullptr, nullptr, nullptr));
    if (!scaler_)
        return absl::InvalidArgumentError(fmt::format(
            "{}: the pixels of {} are of an unknown kind; convert it with ffmpeg", whose_, file_.string()));
    if (!bgr_ || bgr_->width != width || bgr_->height != height) {
        bgr_.reset(av_frame_alloc());
        bgr_->format = AV_PIX_FMT_BGR24, bgr_->width = width, bgr_->height = height;
        if (av_frame_get_buffer(bgr_.get(), 32) < 0)
            return absl::ResourceExhaustedError(
                fmt::format("{}: no memory for a picture of {}", whose_, file_.string()));
    }
    sws_scale(scaler_.get(), frame.data, frame.linesize, 0, height, bgr_->data, bgr_->linesize);
    auto data = pool_.take();
    const cv::Mat shown(frame.height, frame.width, CV_8UC3, bgr_->data[0],
                        static_cast<std::size_t>(bgr_->linesize[0]));
    cv::Mat out(camera_.height, camera_.width, CV_8UC3, data.get());
    switch (turn_deg_) {
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
    return Picture{camera_.width, camera_.height, 3, std::move(data)};
}

}  // namespace

absl::StatusOr<std::unique_ptr<PictureReader>> open_container_video(const fs::path& file,
                                                                    const Camera& camera) {
    auto packets = VideoPackets::open(file, "camera " + camera.name);
    if (!packets.ok()) return packets.status();
    auto video = std::make_unique<ContainerVideo>(file, camera, *std::move(packets));
    if (absl::Status opened = video->open(); !opened.ok()) return opened;
    return video;
}

}  // namespace kinevox
