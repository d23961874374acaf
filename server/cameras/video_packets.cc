#include "server/cameras/video_packets.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <span>
#include <string_view>

extern "C" {
#include <libavutil/display.h>
}

namespace kinevox {
namespace {

// Codecs of which each packet is one visible image (VP8 has hidden ones).
bool packet_is_image(AVCodecID codec) {
    switch (codec) {
        case AV_CODEC_ID_H264:
        case AV_CODEC_ID_HEVC:
        case AV_CODEC_ID_VP9:
        case AV_CODEC_ID_AV1:
        case AV_CODEC_ID_MPEG2VIDEO:
        case AV_CODEC_ID_MPEG4:
            return true;
        default:
            break;
    }
    const AVCodecDescriptor* const about = avcodec_descriptor_get(codec);
    return about && (about->props & AV_CODEC_PROP_INTRA_ONLY);
}

bool is_mp4(const AVFormatContext& container) {
    return std::string_view(container.iformat->name).find("mp4") != std::string_view::npos;
}
bool is_avi(const AVFormatContext& container) {
    return std::string_view(container.iformat->name) == "avi";
}

}  // namespace

absl::StatusOr<std::unique_ptr<VideoPackets>> VideoPackets::open(const std::filesystem::path& file,
                                                                 const std::string& whose) {
    std::unique_ptr<VideoPackets> packets(new VideoPackets(file, whose));
    packets->held_.reset(av_packet_alloc());
    if (absl::Status opened = packets->restart(); !opened.ok()) return opened;
    const AVStream& stream = *packets->stream_;
    packets->of_container_ = packets->read_container_index();
    if (packets->of_container_)
        packets->promised_ = packets->images_;
    else if (stream.nb_frames > 0)
        packets->promised_ = stream.nb_frames;
    packets->exact_ = packets->of_container_ || (stream.nb_frames > 0 && is_avi(*packets->container_));
    if (packets->promised_ < 0) {  // an estimate
        const double seconds = stream.duration != AV_NOPTS_VALUE
                                   ? static_cast<double>(stream.duration) * av_q2d(stream.time_base)
                                   : static_cast<double>(packets->container_->duration) / AV_TIME_BASE;
        const double frames =
            seconds * av_q2d(stream.avg_frame_rate.num ? stream.avg_frame_rate : stream.r_frame_rate);
        if (frames >= 1 && frames < 1e9) packets->promised_ = static_cast<std::int64_t>(frames + 0.5);
    }
    return packets;
}

absl::Status VideoPackets::restart() {
    holds_ = false;
    container_.reset();
    AVFormatContext* opened = nullptr;
    AVDictionary* options = nullptr;
    av_dict_set(&options, "protocol_whitelist", "file",
                0);  // references to other files are not followed
    const int error = avformat_open_input(&opened, file_.c_str(), nullptr, &options);
    av_dict_free(&options);
    container_.reset(error < 0 ? nullptr : opened);
    stream_ = nullptr;
    int best = -1;
    if (container_ && avformat_find_stream_info(container_.get(), nullptr) >= 0)
        for (unsigned s = 0; s < container_->nb_streams && best < 0; ++s) {
            decoder_ = avcodec_find_decoder(container_->streams[s]->codecpar->codec_id);
            if (container_->streams[s]->codecpar->codec_type == AVMEDIA_TYPE_VIDEO && decoder_)
                best = static_cast<int>(s);
        }
    if (best < 0)
        return absl::InvalidArgumentError(
            fmt::format("{}: {} cannot be read as a video: it is damaged, truncated or of an unknown format; "
                        "copy it again or convert it with ffmpeg",
                        whose_, file_));
    stream_ = container_->streams[best];
    for (unsigned s = 0; s < container_->nb_streams; ++s)
        if (static_cast<int>(s) != best) container_->streams[s]->discard = AVDISCARD_ALL;
    return absl::OkStatus();
}

int VideoPackets::rotation_deg() const {
    const auto* const matrix = reinterpret_cast<const std::int32_t*>(
        av_stream_get_side_data(stream_, AV_PKT_DATA_DISPLAYMATRIX, nullptr));
    const double angle_deg = matrix ? -av_display_rotation_get(matrix) : 0;
    const int rotation_deg =
        std::isfinite(angle_deg) ? static_cast<int>(std::lround(angle_deg) + 360) % 360 : 0;
    return rotation_deg % 90 == 0 ? rotation_deg : 0;
}

int VideoPackets::next(AVPacket* packet) {
    av_packet_unref(packet);
    if (std::exchange(holds_, false)) {
        av_packet_move_ref(packet, held_.get());
        return 0;
    }
    for (;;) {
        const int error = av_read_frame(container_.get(), packet);
        if (error < 0) return error;
        if (packet->stream_index == stream_->index) return 0;
        av_packet_unref(packet);
    }
}

// MP4 and AVI have an index entry per packet. Packets excluded by an edit list are missing or marked;
// fragmented files and truncated AVI files have no index.
bool VideoPackets::read_container_index() {
    const int entries = avformat_index_get_entries_count(stream_);
    if (stream_->nb_frames < 1 || entries < 1) return false;
    if (!is_mp4(*container_) && !(is_avi(*container_) && entries >= stream_->nb_frames)) return false;
    for (int n = 0; n < entries; ++n) {
        const AVIndexEntry& entry = *avformat_index_get_entry(stream_, n);
        if (entry.flags & AVINDEX_KEYFRAME) keys_.push_back({n, images_, entry.timestamp});
        if (!(entry.flags & AVINDEX_DISCARD_FRAME)) ++images_;
    }
    return true;
}

absl::Status VideoPackets::read_through() {
    const auto other = open(file_, whose_);  // keeps the position of this one
    if (!other.ok()) return other.status();
    const libav::Owned<AVPacket> packet(av_packet_alloc());
    usable_ = true;
    for (std::int64_t n = 0; (*other)->next(packet.get()) >= 0; ++n) {
        usable_ = usable_ && packet->pts != AV_NOPTS_VALUE;
        if (packet->flags & AV_PKT_FLAG_KEY) keys_.push_back({n, images_, packet->pts});
        if (!(packet->flags & AV_PKT_FLAG_DISCARD)) ++images_;
    }
    return absl::OkStatus();
}

absl::StatusOr<bool> VideoPackets::index() {
    if (indexed_) return usable_;
    usable_ = of_container_;
    if (!of_container_)
        if (absl::Status read = read_through(); !read.ok()) return read;
    indexed_ = true;
    usable_ = usable_ && packet_is_image(stream_->codecpar->codec_id) && !keys_.empty() &&
              keys_.front().packets_before == 0 &&
              std::ranges::adjacent_find(keys_, std::greater_equal(), &KeyPacket::timestamp) == keys_.end();
    return usable_;
}

std::int64_t VideoPackets::timestamp_of(const AVPacket& packet) const {
    return of_container_ ? packet.dts : packet.pts;
}

// Seeks to a timestamp and reads on to a key. If it is the wanted key or an earlier one, returns the number
// of packets before it and holds its packet.
std::optional<std::int64_t> VideoPackets::lead_to(const KeyPacket& wanted, std::int64_t timestamp) {
    if (av_seek_frame(container_.get(), stream_->index, timestamp, AVSEEK_FLAG_BACKWARD) < 0)
        return std::nullopt;
    const std::span<const KeyPacket> upto(keys_.data(), static_cast<std::size_t>(&wanted - keys_.data()) + 1);
    while (next(held_.get()) >= 0 && timestamp_of(*held_) <= wanted.timestamp) {
        const auto found = std::ranges::lower_bound(upto, timestamp_of(*held_), {}, &KeyPacket::timestamp);
        if (found != upto.end() && found->timestamp == timestamp_of(*held_)) return found->packets_before;
    }
    return std::nullopt;
}

absl::Status VideoPackets::go_to(const KeyPacket& key) {
    holds_ = false;
    std::optional<std::int64_t> at;
    if (of_container_) {
        // MP4 seeks by presentation time, but its index stores decoding times, which are earlier.
        const int entries = avformat_index_get_entries_count(stream_);
        at = lead_to(key, &key == &keys_.back() ? avformat_index_get_entry(stream_, entries - 1)->timestamp
                                                : (&key + 1)->timestamp - 1);
    } else {
        at = lead_to(key, key.timestamp);
        if (!at && &key != &keys_.front())
            at = lead_to(key, (&key - 1)->timestamp);  // the seek ended after the key
    }
    if (!at) {
        if (absl::Status begun = restart(); !begun.ok()) return begun;
        at = -1;
    }
    for (; *at < key.packets_before; ++*at)
        if (const int error = next(held_.get()); error < 0)
            return absl::DataLossError(
                fmt::format("{}: {} ends after {} frames ({}): it is damaged or truncated; copy it again",
                            whose_, file_, *at + 1, libav::reason(error)));
    holds_ = true;
    return absl::OkStatus();
}

}  // namespace kinevox
