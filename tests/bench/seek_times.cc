// How long a recording takes from a seek to the frame set: seek_times SESSION.toml [SEEKS], and how a long recording is
// made of a short one: seek_times --lengthen VIDEO TIMES OUT, the same pictures over and over, not encoded anew.
#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <fmt/format.h>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
}

#include "server/cameras/replay_source.h"
#include "server/cameras/session_source.h"

namespace {

using namespace kinevox;

int fail(const std::string& why) {
    fmt::print(stderr, "seek_times: {}\n", why);
    return 1;
}

int lengthen(const char* video, int times, const char* out) {
    AVFormatContext* to = nullptr;
    if (avformat_alloc_output_context2(&to, nullptr, nullptr, out) < 0) return fail("cannot make " + std::string(out));
    AVPacket* const packet = av_packet_alloc();
    std::int64_t begin = 0;
    for (int k = 0; k < times; ++k) {
        AVFormatContext* from = nullptr;
        if (avformat_open_input(&from, video, nullptr, nullptr) < 0 || avformat_find_stream_info(from, nullptr) < 0)
            return fail("cannot read " + std::string(video));
        const AVStream* const source = from->streams[0];
        if (k == 0) {
            AVStream* const stream = avformat_new_stream(to, nullptr);
            avcodec_parameters_copy(stream->codecpar, source->codecpar);
            stream->codecpar->codec_tag = 0;
            stream->time_base = source->time_base;
            stream->avg_frame_rate = source->avg_frame_rate;
            if (avio_open(&to->pb, out, AVIO_FLAG_WRITE) < 0 || avformat_write_header(to, nullptr) < 0)
                return fail("cannot write " + std::string(out));
        }
        std::int64_t end = begin;
        while (av_read_frame(from, packet) >= 0) {
            packet->pts += begin, packet->dts += begin;
            end = std::max(end, packet->pts + packet->duration);
            packet->pos = -1;
            av_packet_rescale_ts(packet, source->time_base, to->streams[0]->time_base);
            if (av_write_frame(to, packet) < 0) return fail("cannot write " + std::string(out));
            av_packet_unref(packet);
        }
        begin = end;
        avformat_close_input(&from);
    }
    av_write_trailer(to);
    avio_closep(&to->pb);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc == 5 && argv[1] == std::string("--lengthen")) return lengthen(argv[2], std::atoi(argv[3]), argv[4]);
    if (argc < 2 || argc > 3) return fail("give SESSION.toml [SEEKS]");
    silence_video_libraries();
    auto source = ReplaySource::open(argv[1], {.paused = true});
    if (!source.ok()) return fail(std::string(source.status().message()));
    if (const auto first = (*source)->next(); !first.ok()) return fail(std::string(first.status().message()));
    const std::int64_t frames = (*source)->position().frames;
    const int seeks = argc == 3 ? std::atoi(argv[2]) : 200;
    std::mt19937 random(1);
    std::vector<double> ms;
    for (int k = 0; k < seeks; ++k) {
        const std::int64_t frame = std::uniform_int_distribution<std::int64_t>(0, frames - 1)(random);
        const auto begun = std::chrono::steady_clock::now();
        if (absl::Status sought = (*source)->seek(frame); !sought.ok()) return fail(std::string(sought.message()));
        const auto set = (*source)->next();
        if (!set.ok()) return fail(std::string(set.status().message()));
        ms.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begun).count());
        if (set->recorded_frame != frame) return fail(fmt::format("frame {} came as {}", frame, *set->recorded_frame));
    }
    std::ranges::sort(ms);
    const auto at = [&](double part) { return ms[static_cast<std::size_t>(part * static_cast<double>(ms.size() - 1))]; };
    fmt::print("{} {} {:.1f} {:.1f} {:.1f}\n", frames, seeks, at(0.5), at(0.95), ms.back());
    return 0;
}
