#include "server/recording/growing_files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <optional>
#include <string>
#include <utility>

#include "common/recording_files.h"
#include "server/cameras/libav.h"

namespace kinevox {
namespace {

// Reads EBML, the encoding of Matroska: an identifier, a length, the payload.
class EbmlReader {
  public:
    explicit EbmlReader(std::string_view bytes) : bytes_(bytes) {}
    std::size_t at() const { return at_; }
    void skip(std::uint64_t bytes) { at_ += bytes; }
    // A number whose first set bit encodes its length; identifiers keep that bit.
    std::optional<std::uint64_t> number(bool keep_marker) {
        if (at_ >= bytes_.size()) return std::nullopt;
        const auto first = static_cast<unsigned char>(bytes_[at_]);
        int length = 1;
        while (length <= 8 && !(first & (0x80 >> (length - 1)))) ++length;
        if (length > 8 || at_ + static_cast<std::size_t>(length) > bytes_.size()) return std::nullopt;
        std::uint64_t value = keep_marker ? first : first & (0xff >> length);
        for (int i = 1; i < length; ++i) value = value << 8 | static_cast<unsigned char>(bytes_[at_ + i]);
        at_ += static_cast<std::size_t>(length);
        return value;
    }

  private:
    std::string_view bytes_;
    std::size_t at_ = 0;
};

struct Payload {
    std::size_t offset = 0, bytes = 0;  // in the cluster
};

// The position of the image in a cluster whose last element is one simple block.
std::optional<Payload> payload_of(std::string_view cluster) {
    constexpr std::uint64_t kCluster = 0x1F43B675, kSimpleBlock = 0xA3;
    constexpr std::size_t kBlockHeader = 3;  // after the track number: time and flags
    EbmlReader reader(cluster);
    const auto id = reader.number(true), size = reader.number(false);
    if (id != kCluster || !size) return std::nullopt;
    while (const auto element = reader.number(true)) {
        const auto bytes = reader.number(false);
        if (!bytes) return std::nullopt;
        const std::size_t begin = reader.at();
        if (*element != kSimpleBlock) {
            reader.skip(*bytes);
            continue;
        }
        if (!reader.number(false)) return std::nullopt;
        const std::size_t offset = reader.at() + kBlockHeader, end = begin + *bytes;
        if (offset >= end || end != cluster.size()) return std::nullopt;
        return Payload{offset, end - offset};
    }
    return std::nullopt;
}

class MatroskaFile final : public VideoFile {
  public:
    ~MatroskaFile() override {
        if (io_) {
            av_freep(&io_->buffer);
            avio_context_free(&io_);
        }
    }

    absl::Status open(const std::filesystem::path& video, const VideoFormat& format);
    absl::Status append(const EncodedImage& image, std::int64_t time_ns) override;
    absl::Status take_back() override;
    absl::Status close() override;
    void sync() const override {
        video_.sync();
        index_.sync();
    }
    std::uint64_t frames() const override { return frames_; }
    std::uint64_t bytes() const override { return video_.size() + index_.size(); }

  private:
    static int write(void* self, std::uint8_t* bytes, int count) {
        return static_cast<MatroskaFile*>(self)->gather(
            {reinterpret_cast<const char*>(bytes), static_cast<std::size_t>(count)});
    }
    static std::int64_t seek(void* self, std::int64_t offset, int whence) {
        return static_cast<MatroskaFile*>(self)->go_to(offset, whence);
    }
    int gather(std::string_view bytes);
    std::int64_t go_to(std::int64_t offset, int whence);
    absl::Status flush();
    absl::Status failed(int error) const {
        if (!write_status_.ok()) return write_status_;
        return absl::UnavailableError(
            fmt::format("{}: the video cannot be written: {}", video_.path().string(), libav::reason(error)));
    }

    AppendFile video_, index_;
    AVIOContext* io_ = nullptr;
    libav::Owned<AVFormatContext> container_;
    AVStream* stream_ = nullptr;
    libav::Owned<AVPacket> packet_;
    // FFmpeg's output since the last flush(), appended at once, so that clusters are complete.
    std::string gathered_;
    std::uint64_t gathered_at_ = 0, position_ = 0;
    absl::Status write_status_;
    std::uint64_t frames_ = 0, before_last_ = 0;
    std::int64_t last_pts_ = -1;
};

int MatroskaFile::gather(std::string_view bytes) {
    if (position_ != gathered_at_ + gathered_.size()) {  // it seeks back to fill in a field
        write_status_.Update(flush());
        gathered_at_ = position_;
    }
    gathered_.append(bytes);
    position_ += bytes.size();
    return write_status_.ok() ? static_cast<int>(bytes.size()) : AVERROR(EIO);
}

std::int64_t MatroskaFile::go_to(std::int64_t offset, int whence) {
    const std::uint64_t size = std::max(video_.size(), gathered_at_ + gathered_.size());
    if (whence == AVSEEK_SIZE) return static_cast<std::int64_t>(size);
    if (whence == SEEK_CUR) offset += static_cast<std::int64_t>(position_);
    if (whence == SEEK_END) offset += static_cast<std::int64_t>(size);
    if (offset < 0) return AVERROR(EINVAL);
    position_ = static_cast<std::uint64_t>(offset);
    return offset;
}

absl::Status MatroskaFile::flush() {
    absl::Status written = gathered_.empty()               ? absl::OkStatus()
                           : gathered_at_ == video_.size() ? video_.append(gathered_)
                                                           : video_.write_at(gathered_at_, gathered_);
    gathered_at_ += gathered_.size();
    gathered_.clear();
    return written;
}

absl::Status MatroskaFile::open(const std::filesystem::path& video, const VideoFormat& format) {
    auto file = AppendFile::create(video);
    if (!file.ok()) return file.status();
    video_ = *std::move(file);
    auto index = AppendFile::create(video_index_file(video));
    if (!index.ok()) return index.status();
    index_ = *std::move(index);
    if (absl::Status begun = index_.append(kVideoIndexHeader); !begun.ok()) return begun;

    constexpr int kBufferBytes = 1 << 16;
    io_ = avio_alloc_context(static_cast<unsigned char*>(av_malloc(kBufferBytes)), kBufferBytes, 1, this,
                             nullptr, &write, &seek);
    AVFormatContext* container = nullptr;
    if (int e = avformat_alloc_output_context2(&container, nullptr, "matroska", nullptr); e < 0)
        return failed(e);
    container_.reset(container);
    container_->pb = io_;
    container_->flags |= AVFMT_FLAG_CUSTOM_IO | AVFMT_FLAG_BITEXACT;
    stream_ = avformat_new_stream(container_.get(), nullptr);
    const AVRational rate = av_d2q(format.fps, 100000);
    stream_->time_base = {1, 1'000'000'000};
    stream_->avg_frame_rate = rate;
    AVCodecParameters& parameters = *stream_->codecpar;
    parameters.codec_type = AVMEDIA_TYPE_VIDEO;
    parameters.width = format.width;
    parameters.height = format.height;
    switch (format.codec) {
        case VideoCodec::kFfv1:
            parameters.codec_id = AV_CODEC_ID_FFV1;
            parameters.format = AV_PIX_FMT_BGR0;
            break;
        case VideoCodec::kUtVideo:
            parameters.codec_id = AV_CODEC_ID_UTVIDEO;
            parameters.codec_tag = MKTAG('U', 'L', 'R', 'G');
            parameters.format = AV_PIX_FMT_GBRP;
            break;
        case VideoCodec::kH264:
            parameters.codec_id = AV_CODEC_ID_H264;
            parameters.format = AV_PIX_FMT_YUV420P;
            break;
    }
    parameters.extradata =
        static_cast<std::uint8_t*>(av_mallocz(format.extra_data.size() + AV_INPUT_BUFFER_PADDING_SIZE));
    std::copy(format.extra_data.begin(), format.extra_data.end(), parameters.extradata);
    parameters.extradata_size = static_cast<int>(format.extra_data.size());
    if (int e = avformat_write_header(container_.get(), nullptr); e < 0) return failed(e);
    avio_flush(io_);
    packet_.reset(av_packet_alloc());
    return flush();
}

absl::Status MatroskaFile::append(const EncodedImage& image, std::int64_t time_ns) {
    const std::uint64_t cluster = video_.size();
    packet_->data =
        reinterpret_cast<std::uint8_t*>(const_cast<char*>(image.bytes.data()));  // FFmpeg only reads it
    packet_->size = static_cast<int>(image.bytes.size());
    packet_->stream_index = 0;
    packet_->flags = image.key ? AV_PKT_FLAG_KEY : 0;
    // The container counts milliseconds; the exact time is the index's.
    last_pts_ = std::max(last_pts_ + 1, av_rescale_q(time_ns, {1, 1'000'000'000}, stream_->time_base));
    packet_->pts = packet_->dts = last_pts_;
    int e = av_write_frame(container_.get(), packet_.get());
    packet_->data = nullptr;
    packet_->size = 0;
    if (e >= 0) e = av_write_frame(container_.get(), nullptr);  // ends the cluster
    avio_flush(io_);
    const std::optional<Payload> payload = payload_of(gathered_);
    if (e < 0 || !write_status_.ok() || !payload || gathered_at_ != cluster) {
        gathered_.clear();
        return failed(e < 0 ? e : AVERROR_BUG);
    }
    if (absl::Status written = flush(); !written.ok()) return write_status_ = written;
    VideoIndexEntry entry;
    entry.payload_offset = cluster + payload->offset;
    entry.cluster_offset = cluster;
    entry.time_ns = time_ns;
    entry.payload_bytes = static_cast<std::uint32_t>(payload->bytes);
    entry.flags = (image.key ? VideoIndexEntry::kKey : 0) | (image.missing ? VideoIndexEntry::kMissing : 0);
    if (absl::Status indexed = index_.append(video_index_bytes(entry)); !indexed.ok()) {
        video_.truncate(cluster).IgnoreError();
        return write_status_ = indexed;
    }
    before_last_ = cluster;
    ++frames_;
    return absl::OkStatus();
}

absl::Status MatroskaFile::take_back() {
    if (absl::Status shorter = index_.truncate(index_.size() - kVideoIndexEntryBytes); !shorter.ok())
        return shorter;
    --frames_;
    write_status_ = absl::CancelledError(
        fmt::format("{}: was truncated", video_.path().string()));  // FFmpeg does not know
    return video_.truncate(before_last_);
}

absl::Status MatroskaFile::close() {
    if (!container_) return absl::OkStatus();
    absl::Status closed = write_status_;
    if (closed.ok()) {
        if (int e = av_write_trailer(container_.get()); e < 0) closed = failed(e);
        avio_flush(io_);
        closed.Update(write_status_);
        closed.Update(flush());
    }
    container_.reset();
    sync();
    return closed;
}

}  // namespace

absl::StatusOr<AppendFile> AppendFile::create(const std::filesystem::path& file) {
    AppendFile made;
    made.path_ = file;
    made.descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
    if (made.descriptor_ < 0) return made.failed(errno);
    return made;
}

AppendFile::AppendFile(AppendFile&& other) noexcept {
    *this = std::move(other);
}

AppendFile& AppendFile::operator=(AppendFile&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_, other.size_);
    return *this;
}

AppendFile::~AppendFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
}

absl::Status AppendFile::failed(int error) const {
    const std::string what = fmt::format("{}: {}", path_.string(), std::strerror(error));
    if (error == ENOSPC || error == EDQUOT)
        return absl::ResourceExhaustedError(what + "; free some space or record to another disk");
    if (error == EEXIST) return absl::AlreadyExistsError(what + "; choose another name");
    return absl::UnavailableError(what + "; correct [recording] folder or its rights");
}

absl::Status AppendFile::write_at(std::uint64_t offset, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t written = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) return failed(written < 0 ? errno : EIO);
        bytes.remove_prefix(static_cast<std::size_t>(written));
        offset += static_cast<std::uint64_t>(written);
        size_ = std::max(size_, offset);
    }
    return absl::OkStatus();
}

absl::Status AppendFile::append(std::string_view bytes) {
    const std::uint64_t before = size_;
    absl::Status written = write_at(before, bytes);
    if (!written.ok()) truncate(before).IgnoreError();
    return written;
}

absl::Status AppendFile::truncate(std::uint64_t bytes) {
    if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0) return failed(errno);
    size_ = bytes;
    return absl::OkStatus();
}

void AppendFile::sync() const {
    ::fdatasync(descriptor_);
}

bool AppendFile::lock() const {
    return ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
}

absl::StatusOr<std::unique_ptr<VideoFile>> VideoFile::create(const std::filesystem::path& video,
                                                             const VideoFormat& format) {
    auto file = std::make_unique<MatroskaFile>();
    if (absl::Status opened = file->open(video, format); !opened.ok()) return opened;
    return file;
}

}  // namespace kinevox
