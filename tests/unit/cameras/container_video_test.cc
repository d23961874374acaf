// Videos in the containers and codecs that people have: each image is the one that OpenCV reads at that
// place, bit for bit, wherever it is sought from.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <random>
#include <string>
#include <vector>

#include "server/cameras/image_reader.h"

extern "C" {
#include <libavutil/display.h>
}

#include "server/cameras/libav.h"
#include "server/cameras/session_source.h"
#include "tests/support/temporary_folder.h"
#include "tests/support/test_data.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

struct Kind {
    std::string name, extension, codec, options;  // of the codec
    std::string container_options = {};
    AVPixelFormat pixels = AV_PIX_FMT_YUV420P;
    int frames = 120;
    int width = 64, height = 56;  // px; blocks of 16 do not fit into the height
    bool even_times = true;
    int rotation_deg = 0;  // to be shown upright, as a phone that was held so writes it
};

AVDictionary* dictionary(const std::string& options) {
    AVDictionary* made = nullptr;
    av_dict_parse_string(&made, options.c_str(), "=", ",", 0);
    return made;
}

// Bars that move over grey and a little noise; each frame differs from all others.
void draw(AVFrame& frame, int n, std::mt19937& random) {
    const AVPixFmtDescriptor& format = *av_pix_fmt_desc_get(static_cast<AVPixelFormat>(frame.format));
    for (int p = 0; p < av_pix_fmt_count_planes(static_cast<AVPixelFormat>(frame.format)); ++p) {
        const bool chroma = p == 1 || p == 2;
        const int width = chroma ? AV_CEIL_RSHIFT(frame.width, format.log2_chroma_w) : frame.width;
        const int height = chroma ? AV_CEIL_RSHIFT(frame.height, format.log2_chroma_h) : frame.height;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width * format.comp[p].step; ++x) {
                const int value = 60 + 30 * p + ((x + 3 * n) % 24 < 8 ? 70 : 0) + (y + n) % 16 +
                                  static_cast<int>(random() % 8);
                if (format.comp[0].depth > 8)
                    reinterpret_cast<std::uint16_t*>(frame.data[p] + y * frame.linesize[p])[x / 2] =
                        static_cast<std::uint16_t>(4 * value);
                else
                    frame.data[p][y * frame.linesize[p] + x] = static_cast<std::uint8_t>(value);
            }
    }
}

// False where this FFmpeg lacks the encoder.
bool write(const fs::path& file, const Kind& kind) {
    const AVCodec* const codec = avcodec_find_encoder_by_name(kind.codec.c_str());
    if (!codec) return false;
    const libav::Owned<AVCodecContext> encoder(avcodec_alloc_context3(codec));
    encoder->width = kind.width, encoder->height = kind.height;
    encoder->time_base = {1, kind.even_times ? 30 : 1000};
    encoder->framerate = {30, 1};
    encoder->pix_fmt = kind.pixels;
    encoder->thread_count = 1;
    encoder->log_level_offset = 64;
    AVFormatContext* opened = nullptr;
    avformat_alloc_output_context2(&opened, nullptr, nullptr, file.c_str());
    const libav::Owned<AVFormatContext> container(opened);
    if (container->oformat->flags & AVFMT_GLOBALHEADER) encoder->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
    AVDictionary* options = dictionary(kind.options);
    EXPECT_GE(avcodec_open2(encoder.get(), codec, &options), 0);
    av_dict_free(&options);
    AVStream* const stream = avformat_new_stream(container.get(), nullptr);
    if (kind.rotation_deg != 0)
        av_display_rotation_set(reinterpret_cast<std::int32_t*>(av_stream_new_side_data(
                                    stream, AV_PKT_DATA_DISPLAYMATRIX, 9 * sizeof(std::int32_t))),
                                kind.rotation_deg);
    stream->time_base = encoder->time_base;
    if (kind.even_times) stream->avg_frame_rate = encoder->framerate;
    avcodec_parameters_from_context(stream->codecpar, encoder.get());
    EXPECT_GE(avio_open(&container->pb, file.c_str(), AVIO_FLAG_WRITE), 0);
    options = dictionary(kind.container_options);
    EXPECT_GE(avformat_write_header(container.get(), &options), 0);
    av_dict_free(&options);
    const libav::Owned<AVPacket> packet(av_packet_alloc());
    std::mt19937 random(5);
    std::int64_t time = 0;
    for (int n = 0; n <= kind.frames; ++n) {
        libav::Owned<AVFrame> frame(n < kind.frames ? av_frame_alloc() : nullptr);
        if (frame) {
            frame->format = kind.pixels, frame->width = kind.width, frame->height = kind.height;
            EXPECT_GE(av_frame_get_buffer(frame.get(), 0), 0);
            draw(*frame, n, random);
            frame->pts = kind.even_times ? n : time;
            time += n % 7 == 3 ? 400 : 20 + n % 40;
        }
        EXPECT_GE(avcodec_send_frame(encoder.get(), frame.get()), 0);
        while (avcodec_receive_packet(encoder.get(), packet.get()) == 0) {
            if (kind.even_times) packet->duration = 1;
            av_packet_rescale_ts(packet.get(), encoder->time_base, stream->time_base);
            packet->stream_index = stream->index;
            EXPECT_GE(av_interleaved_write_frame(container.get(), packet.get()), 0);
        }
    }
    EXPECT_GE(av_write_trailer(container.get()), 0);
    return true;
}

Camera camera_of(const Kind& kind) {
    Camera camera;
    camera.name = "left", camera.width = kind.width, camera.height = kind.height;
    if (kind.rotation_deg % 180 != 0) std::swap(camera.width, camera.height);
    return camera;
}

std::vector<cv::Mat> read_by_opencv(const fs::path& file, int rotation_deg = 0) {
    std::vector<cv::Mat> images;
    cv::VideoCapture capture(file.string(), cv::CAP_FFMPEG);
    capture.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);  // OpenCV 4.6 turns the wrong way
    for (cv::Mat image; capture.read(image);) {
        images.push_back(image.clone());
        const std::array turns{cv::ROTATE_90_CLOCKWISE, cv::ROTATE_180, cv::ROTATE_90_COUNTERCLOCKWISE};
        if (rotation_deg > 0)
            cv::rotate(image, images.back(), turns[static_cast<std::size_t>(rotation_deg / 90 - 1)]);
    }
    return images;
}

bool same(const Image& a, const cv::Mat& b) {
    return a.width == b.cols && a.height == b.rows && b.isContinuous() &&
           std::memcmp(a.data.get(), b.data, b.total() * 3) == 0;
}

class ContainerVideo : public ::testing::TestWithParam<Kind> {
  protected:
    void SetUp() override { silence_video_libraries(); }
    testing::TemporaryFolder folder_;
};

TEST_P(ContainerVideo, SeekDeliversExactImageFromAnyPosition) {
    const Kind& kind = GetParam();
    const fs::path file = folder_ / ("video." + kind.extension);
    if (!write(file, kind)) GTEST_SKIP() << "this FFmpeg has no " << kind.codec;
    const std::vector<cv::Mat> truth = read_by_opencv(file, kind.rotation_deg);
    const int frames = static_cast<int>(truth.size());
    ASSERT_GE(frames, kind.frames - 1);  // MOV's edit list leaves out a last one that lasts no time

    auto video = open_container_video(file, camera_of(kind));
    ASSERT_TRUE(video.ok()) << video.status();
    for (int round = 0; round < 2; ++round) {
        for (std::size_t n = 0; n < truth.size(); ++n) {
            const auto image = (*video)->next();
            ASSERT_TRUE(image.ok()) << n << ": " << image.status();
            ASSERT_TRUE(same(*image, truth[n])) << n;
        }
        EXPECT_TRUE(absl::IsOutOfRange((*video)->next().status()));
        EXPECT_TRUE(absl::IsOutOfRange((*video)->next().status())) << "and stays so";
        ASSERT_TRUE((*video)->rewind().ok());
    }

    video = open_container_video(file, camera_of(kind));
    ASSERT_TRUE(video.ok()) << video.status();
    const auto counted = (*video)->count();
    ASSERT_TRUE(counted.ok()) << counted.status();
    EXPECT_EQ(*counted, frames);
    EXPECT_TRUE(!(*video)->promise_is_exact() || (*video)->promised() == frames) << (*video)->promised();
    // To any place, then on, and back step by step.
    std::mt19937 random(1);
    const auto expect = [&](int frame) {
        ASSERT_TRUE((*video)->seek(frame).ok());
        for (int n = frame; n < std::min(frame + 3, frames); ++n) {
            const auto image = (*video)->next();
            ASSERT_TRUE(image.ok()) << n << ": " << image.status();
            ASSERT_TRUE(same(*image, truth[static_cast<std::size_t>(n)])) << n << " behind " << frame;
        }
    };
    for (int k = 0; k < 40; ++k)
        ASSERT_NO_FATAL_FAILURE(expect(static_cast<int>(random() % static_cast<unsigned>(frames))));
    for (int frame = frames - 1; frame > frames - 40; --frame) ASSERT_NO_FATAL_FAILURE(expect(frame));
    for (const int frame : {0, 1, frames - 1, 0, frames / 2}) ASSERT_NO_FATAL_FAILURE(expect(frame));
    EXPECT_TRUE(absl::IsOutOfRange((*video)->seek(-1)));
    absl::Status beyond = (*video)->seek(frames);
    if (beyond.ok()) beyond = (*video)->next().status();
    EXPECT_TRUE(absl::IsOutOfRange(beyond)) << beyond;
    ASSERT_NO_FATAL_FAILURE(expect(frames / 3));
}

INSTANTIATE_TEST_SUITE_P(
    All, ContainerVideo,
    ::testing::Values(
        Kind{"Mp4FewKeys", "mp4", "libx264", "preset=medium", {}, AV_PIX_FMT_YUV420P, 300},
        Kind{"Mp4IndexFirst", "mp4", "libx264", "g=30", "movflags=faststart"},
        Kind{"Mp4Fragments", "mp4", "libx264", "g=24", "movflags=frag_keyframe+empty_moov"},
        Kind{"Mp4OpenGroups", "mp4", "libx264",
             "x264-params=keyint=24:min-keyint=24:open-gop=1:bframes=3:b-adapt=0"},
        Kind{"MatroskaOpenGroups", "mkv", "libx264",
             "x264-params=keyint=24:min-keyint=24:open-gop=1:bframes=3:b-adapt=0"},
        Kind{"MatroskaNoKeysButTheFirst", "mkv", "libx264", "x264-params=intra-refresh=1:keyint=20"},
        Kind{"MovVariableRate", "mov", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P, 120, 64, 56, false},
        Kind{"MatroskaVariableRate", "mkv", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P, 120, 64, 56, false},
        Kind{"Mp4UprightPhone", "mp4", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P, 60, 64, 56, true, 90},
        Kind{"Mp4PhoneUpsideDown", "mp4", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P, 60, 64, 56, true, 180},
        Kind{"Mp4PhoneTheOtherWay", "mp4", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P, 60, 64, 56, true, 270},
        Kind{"Mp4TenBits", "mp4", "libx264", "g=24", {}, AV_PIX_FMT_YUV420P10},
        Kind{"TransportStream", "ts", "libx264", "g=24"}, Kind{"NoContainer", "h264", "libx264", "g=24"},
        Kind{"Mp4Hevc", "mp4", "libx265",
             "x265-params=keyint=24:min-keyint=24:log-level=none:pools=none:frame-threads=1"},
        Kind{"WebmHiddenImages", "webm", "libvpx", "g=24,auto-alt-ref=1,lag-in-frames=10,b=200000"},
        Kind{"AviMpeg4", "avi", "mpeg4", "g=24,q=3"},
        Kind{"AviMpeg4Reordered", "avi", "mpeg4", "g=24,bf=2,q=3"},
        Kind{"Mp4Mpeg4Reordered", "mp4", "mpeg4", "g=24,bf=2,q=3"},
        Kind{"AviMotionJpegOddSize", "avi", "mjpeg", "q=3", {}, AV_PIX_FMT_YUVJ420P, 60, 65, 49},
        Kind{"AviLossless", "avi", "ffv1", "", {}, AV_PIX_FMT_BGR0, 60, 65, 49}),
    [](const auto& info) { return info.param.name; });

// The videos that `kinevox process` is tested with: it gets the images that OpenCV's reader gave it.
TEST(TestData, DecodesAsOpenCV) {
    silence_video_libraries();
    KINEVOX_REQUIRE_DATA(balancing, "balancing/trial");
    KINEVOX_REQUIRE_DATA(walk, "studio/walk");
    for (const fs::path& file :
         {balancing / "cam01.mp4", walk / "cam1.mp4", walk / "background" / "cam1.mp4"}) {
        SCOPED_TRACE(file);
        cv::VideoCapture capture(file.string(), cv::CAP_FFMPEG);
        Camera camera;
        camera.name = "left";
        camera.width = static_cast<int>(capture.get(cv::CAP_PROP_FRAME_WIDTH));
        camera.height = static_cast<int>(capture.get(cv::CAP_PROP_FRAME_HEIGHT));
        auto video = open_container_video(file, camera), sought = open_container_video(file, camera);
        ASSERT_TRUE(video.ok() && sought.ok()) << video.status() << sought.status();
        cv::Mat truth;
        for (int n = 0; n < 70 && capture.read(truth); ++n) {
            const auto image = (*video)->next();
            ASSERT_TRUE(image.ok()) << image.status();
            ASSERT_TRUE(same(*image, truth)) << n;
            if (n % 23 != 22) continue;
            ASSERT_TRUE((*sought)->seek(n).ok());
            const auto again = (*sought)->next();
            ASSERT_TRUE(again.ok()) << again.status();
            EXPECT_TRUE(same(*again, truth)) << n;
        }
    }
}

// An AVI's index stands at its end, so that one which was cut off has none.
TEST(CutOffVideo, TruncatedVideoEndsWithError) {
    silence_video_libraries();
    const testing::TemporaryFolder folder;
    for (const Kind& kind : {Kind{"avi", "avi", "mpeg4", "g=24,q=3"},
                             Kind{"mp4", "mp4", "libx264", "g=24", "movflags=faststart"},
                             Kind{"mkv", "mkv", "libx264", "g=24"}}) {
        SCOPED_TRACE(kind.name);
        const fs::path whole = folder / ("whole." + kind.extension),
                       file = folder / ("cut." + kind.extension);
        if (!write(whole, kind)) GTEST_SKIP() << "this FFmpeg has no " << kind.codec;
        fs::copy(whole, file);
        fs::resize_file(file, fs::file_size(file) * 6 / 10);
        const std::vector<cv::Mat> truth = read_by_opencv(whole);
        auto video = open_container_video(file, camera_of(kind));
        ASSERT_TRUE(video.ok()) << video.status();
        ASSERT_TRUE((*video)->seek(40).ok());
        const auto sought = (*video)->next();
        ASSERT_TRUE(sought.ok()) << sought.status();
        EXPECT_TRUE(same(*sought, truth[40]));
        ASSERT_TRUE((*video)->rewind().ok());
        int read = 0;
        absl::Status end;
        for (;; ++read) {
            const auto image = (*video)->next();
            end = image.status();
            if (!end.ok()) break;
            EXPECT_TRUE(read >= 50 || same(*image, truth[static_cast<std::size_t>(read)])) << read;
        }
        EXPECT_GT(read, 50);
        EXPECT_LT(read, kind.frames);
        if (kind.name == "mkv") {  // it promises nothing
            EXPECT_TRUE(absl::IsOutOfRange(end)) << end;
            EXPECT_EQ((*video)->count().value_or(-1), read);
            continue;
        }
        EXPECT_TRUE(absl::IsDataLoss(end)) << end;
        EXPECT_THAT(std::string(end.message()), HasSubstr(fmt::format("{} of {} frames", read, kind.frames)));
        absl::Status beyond = (*video)->seek(kind.frames - 1);
        if (beyond.ok()) beyond = (*video)->next().status();
        EXPECT_TRUE(absl::IsDataLoss(beyond)) << beyond;
        EXPECT_THAT(std::string(beyond.message()), HasSubstr("truncated"));
    }
}

}  // namespace
}  // namespace kinevox
