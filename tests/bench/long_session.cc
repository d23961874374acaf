// A long session out of a short one, its first GROUP frame sets over and over: long_session SESSION.toml KIND
// FRAMES OUT. KIND: utvideo, ffv1 or h264, as the recorder writes them; mp4, as x264 makes it by itself: a
// key frame every 250, which is GROUP, with B images between.
#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <cstdlib>
#include <filesystem>
#include <mutex>
#include <string>
#include <vector>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/cameras/libav.h"
#include "server/cameras/session_source.h"
#include "server/recording/recording_folder.h"

namespace {

using namespace kinevox;
namespace fs = std::filesystem;

constexpr int kGroup = 250;

[[noreturn]] void fail(const std::string& why) {
    fmt::print(stderr, "long_session: {}\n", why);
    std::exit(1);
}
void must(const absl::Status& status) {
    if (!status.ok()) fail(std::string(status.message()));
}
void must(int error, const char* what) {
    if (error < 0) fail(fmt::format("cannot {}: {}", what, libav::reason(error)));
}

void record(const std::vector<FrameSet>& sets, const FrameSource& source, VideoCodec codec,
            std::int64_t frames, const fs::path& out) {
    std::mutex mutex;
    std::condition_variable changed;
    std::vector<std::shared_ptr<EncodedSet>> done;
    auto lanes =
        EncodingLanes::create(source.cameras(), source.fps(), codec, [&](std::shared_ptr<EncodedSet> set) {
            const std::scoped_lock lock(mutex);
            done.push_back(std::move(set));
            changed.notify_all();
        });
    must(lanes.status());
    for (std::size_t n = 0; n < sets.size(); ++n) {
        auto set = std::make_shared<EncodedSet>();
        set->number = n;
        set->key = n % static_cast<std::size_t>(key_distance(codec, source.fps())) == 0;
        (*lanes)->put(std::move(set), sets[n].images);
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return done.size() > n; });
        must(done[n]->status);
    }
    RecordingPlan plan;
    plan.folder = out;
    plan.fps = source.fps();
    plan.codec = codec;
    plan.cameras = source.cameras();
    plan.formats = (*lanes)->formats();
    plan.save_poses = plan.save_volumes = false;
    auto folder = RecordingFolder::create(plan);
    must(folder.status());
    for (std::int64_t n = 0; n < frames; ++n) {
        EncodedSet& set = *done[static_cast<std::size_t>(n) % done.size()];
        set.sequence = static_cast<std::uint64_t>(n);
        set.capture_time_ns = static_cast<std::int64_t>(1e9 * static_cast<double>(n) / source.fps());
        must((*folder)->append(set));
    }
    must((*folder)->close({}));
}

// One camera's images, again and again; encoded once.
void write_mp4(const std::vector<FrameSet>& sets, std::size_t camera, double fps, std::int64_t frames,
               const fs::path& file) {
    const AVCodec* const codec = avcodec_find_encoder_by_name("libx264");
    if (!codec) fail("libavcodec has no libx264; install libavcodec-extra");
    const libav::Owned<AVCodecContext> encoder(avcodec_alloc_context3(codec));
    const Image& first = sets[0].images[camera];
    encoder->width = first.width, encoder->height = first.height;
    encoder->framerate = av_d2q(fps, 100000);
    encoder->time_base = av_inv_q(encoder->framerate);
    encoder->pix_fmt = AV_PIX_FMT_YUV420P;
    encoder->gop_size = kGroup;
    encoder->log_level_offset = 64;
    AVFormatContext* opened = nullptr;
    must(avformat_alloc_output_context2(&opened, nullptr, nullptr, file.c_str()), "begin the video");
    const libav::Owned<AVFormatContext> container(opened);
    encoder->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
    must(avcodec_open2(encoder.get(), codec, nullptr), "open the encoder");
    AVStream* const stream = avformat_new_stream(container.get(), nullptr);
    stream->time_base = encoder->time_base;
    must(avcodec_parameters_from_context(stream->codecpar, encoder.get()), "begin the video");
    must(avio_open(&container->pb, file.c_str(), AVIO_FLAG_WRITE), "create the video");
    must(avformat_write_header(container.get(), nullptr), "write the video");
    const libav::Owned<SwsContext> scaler(sws_getContext(first.width, first.height, AV_PIX_FMT_BGR24,
                                                         first.width, first.height, AV_PIX_FMT_YUV420P,
                                                         SWS_BICUBIC, nullptr, nullptr, nullptr));
    std::vector<libav::Owned<AVPacket>> packets;
    const auto collect = [&] {
        for (libav::Owned<AVPacket> packet(av_packet_alloc());
             avcodec_receive_packet(encoder.get(), packet.get()) == 0; packet.reset(av_packet_alloc()))
            packets.push_back(std::move(packet));
    };
    for (std::size_t n = 0; n < sets.size(); ++n) {
        const libav::Owned<AVFrame> frame(av_frame_alloc());
        frame->format = AV_PIX_FMT_YUV420P, frame->width = first.width, frame->height = first.height;
        frame->pts = static_cast<std::int64_t>(n);
        must(av_frame_get_buffer(frame.get(), 0), "hold an image");
        const std::uint8_t* const planes[1] = {sets[n].images[camera].data.get()};
        const int strides[1] = {3 * first.width};
        sws_scale(scaler.get(), planes, strides, 0, first.height, frame->data, frame->linesize);
        must(avcodec_send_frame(encoder.get(), frame.get()), "encode");
        collect();
    }
    must(avcodec_send_frame(encoder.get(), nullptr), "encode");
    collect();
    for (std::int64_t begin = 0; begin < frames; begin += static_cast<std::int64_t>(sets.size()))
        for (const auto& packet : packets) {
            const libav::Owned<AVPacket> copy(av_packet_clone(packet.get()));
            copy->pts += begin, copy->dts += begin, copy->duration = 1;
            av_packet_rescale_ts(copy.get(), encoder->time_base, stream->time_base);
            copy->stream_index = 0;
            must(av_write_frame(container.get(), copy.get()), "write the video");
        }
    must(av_write_trailer(container.get()), "finish the video");
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 5) fail("give SESSION.toml utvideo|ffv1|h264|mp4 FRAMES OUT");
    silence_video_libraries();
    const std::string kind = argv[2];
    const std::int64_t frames = std::atoll(argv[3]);
    const fs::path out = fs::absolute(argv[4]);
    auto source = open_session_source(fs::path(argv[1]));
    must(source.status());
    std::vector<FrameSet> sets;
    while (sets.size() < kGroup) {
        auto set = (*source)->next();
        must(set.status());
        sets.push_back(*std::move(set));
    }
    for (const VideoCodec codec : {VideoCodec::kUtVideo, VideoCodec::kFfv1, VideoCodec::kH264})
        if (kind == name_of(codec)) return record(sets, **source, codec, frames, out), 0;
    if (kind != "mp4") fail("KIND is utvideo, ffv1, h264 or mp4");
    fs::create_directories(out);
    Session session{"long", (*source)->fps(), out / "calibration.toml", {}, {}};
    must(write_calibration_toml((*source)->cameras(), session.calibration));
    for (std::size_t c = 0; c < (*source)->cameras().size(); ++c) {
        const Camera& camera = (*source)->cameras()[c];
        session.cameras.push_back({camera.name, out / (camera.name + ".mp4"), {}});
        write_mp4(sets, c, session.fps, frames, session.cameras.back().video);
    }
    must(write_session(session, out / "session.toml"));
    return 0;
}
