// What H.264 is made of is what the whole image gives at once, and nothing behind the image is read.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <random>
#include <vector>

#include "server/cameras/libav.h"

namespace kinevox {
namespace {

// A image at the end of a page; the next one must not be touched.
class AtTheEnd {
  public:
    explicit AtTheEnd(std::size_t bytes) : page_(static_cast<std::size_t>(sysconf(_SC_PAGESIZE))) {
        size_ = (bytes / page_ + 2) * page_;
        begin_ = static_cast<std::uint8_t*>(
            mmap(nullptr, size_, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0));
        if (begin_ == MAP_FAILED || mprotect(begin_ + size_ - page_, page_, PROT_NONE) != 0)
            throw std::bad_alloc();
        image_ = begin_ + size_ - page_ - bytes;
    }
    ~AtTheEnd() { munmap(begin_, size_); }
    AtTheEnd(const AtTheEnd&) = delete;
    AtTheEnd& operator=(const AtTheEnd&) = delete;
    std::uint8_t* data() const { return image_; }

  private:
    std::size_t page_, size_ = 0;
    std::uint8_t *begin_ = nullptr, *image_ = nullptr;
};

libav::Owned<AVFrame> yuv_frame(int width, int height) {
    libav::Owned<AVFrame> frame(av_frame_alloc());
    frame->format = AV_PIX_FMT_YUV420P, frame->width = width, frame->height = height;
    EXPECT_GE(av_frame_get_buffer(frame.get(), 0), 0);
    return frame;
}

TEST(YuvOfBgr, EqualsWholeImageWithoutOverread) {
    std::mt19937 random(7);
    for (const auto& [width, height] :
         {std::pair{320, 240}, {322, 242}, {1920, 1080}, {640, 482}, {98, 2}, {16, 4}}) {
        const std::size_t bytes = static_cast<std::size_t>(width) * height * 3;
        const AtTheEnd image(bytes);
        for (std::size_t i = 0; i < bytes; ++i) image.data()[i] = static_cast<std::uint8_t>(random());
        const auto found = yuv_frame(width, height), right = yuv_frame(width, height);
        YuvOfBgr(width, height).convert(image.data(), *found);

        std::vector<std::uint8_t> padded(image.data(), image.data() + bytes);
        padded.resize(bytes + 256);
        const libav::Owned<SwsContext> whole(
            sws_getContext(width, height, AV_PIX_FMT_BGR24, width, height, AV_PIX_FMT_YUV420P,
                           SWS_AREA | SWS_ACCURATE_RND | SWS_FULL_CHR_H_INP, nullptr, nullptr, nullptr));
        const std::uint8_t* const from = padded.data();
        const int stride = 3 * width;
        sws_scale(whole.get(), &from, &stride, 0, height, right->data, right->linesize);
        for (int p = 0; p < 3; ++p)
            for (int row = 0; row < (p == 0 ? height : height / 2); ++row)
                ASSERT_EQ(std::memcmp(found->data[p] + row * found->linesize[p],
                                      right->data[p] + row * right->linesize[p],
                                      static_cast<std::size_t>(p == 0 ? width : width / 2)),
                          0)
                    << width << " x " << height << " px, plane " << p << ", row " << row;
    }
}

}  // namespace
}  // namespace kinevox
