#include "server/cameras/aravis/pixel_format.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

namespace kinevox {
namespace {

enum class Layout { kMono, kRggb, kGrbg, kGbrg, kBggr, kRgb, kBgr };
// How a channel of one pixel lies in memory.
enum class Packing {
    k8,  // a byte
    k10,
    k12,  // in two bytes, low byte first
    k10Packed,
    k12Packed,  // GigE Vision's: two pixels in three bytes, the high bits in the first and the last
    k10p,
    k12p,  // GenICam's: bits without gaps, low bits first
};

struct Format {
    Layout layout;
    Packing packing;
};

std::optional<Format> find(std::uint32_t format) {
    using enum Layout;
    using enum Packing;
    switch (format) {
        case 0x01080001:
            return Format{kMono, k8};
        case 0x01100003:
            return Format{kMono, k10};
        case 0x010c0004:
            return Format{kMono, k10Packed};
        case 0x01100005:
            return Format{kMono, k12};
        case 0x010c0006:
            return Format{kMono, k12Packed};
        case 0x010a0046:
            return Format{kMono, k10p};
        case 0x010c0047:
            return Format{kMono, k12p};
        case 0x01080008:
            return Format{kGrbg, k8};
        case 0x01080009:
            return Format{kRggb, k8};
        case 0x0108000a:
            return Format{kGbrg, k8};
        case 0x0108000b:
            return Format{kBggr, k8};
        case 0x0110000c:
            return Format{kGrbg, k10};
        case 0x0110000d:
            return Format{kRggb, k10};
        case 0x0110000e:
            return Format{kGbrg, k10};
        case 0x0110000f:
            return Format{kBggr, k10};
        case 0x01100010:
            return Format{kGrbg, k12};
        case 0x01100011:
            return Format{kRggb, k12};
        case 0x01100012:
            return Format{kGbrg, k12};
        case 0x01100013:
            return Format{kBggr, k12};
        case 0x010c0026:
            return Format{kGrbg, k10Packed};
        case 0x010c0027:
            return Format{kRggb, k10Packed};
        case 0x010c0028:
            return Format{kGbrg, k10Packed};
        case 0x010c0029:
            return Format{kBggr, k10Packed};
        case 0x010c002a:
            return Format{kGrbg, k12Packed};
        case 0x010c002b:
            return Format{kRggb, k12Packed};
        case 0x010c002c:
            return Format{kGbrg, k12Packed};
        case 0x010c002d:
            return Format{kBggr, k12Packed};
        case 0x010a0056:
            return Format{kGrbg, k10p};
        case 0x010a0058:
            return Format{kRggb, k10p};
        case 0x010a0054:
            return Format{kGbrg, k10p};
        case 0x010a0052:
            return Format{kBggr, k10p};
        case 0x010c0057:
            return Format{kGrbg, k12p};
        case 0x010c0059:
            return Format{kRggb, k12p};
        case 0x010c0055:
            return Format{kGbrg, k12p};
        case 0x010c0053:
            return Format{kBggr, k12p};
        case 0x02180014:
            return Format{kRgb, k8};
        case 0x02180015:
            return Format{kBgr, k8};
        default:
            return std::nullopt;
    }
}

// The highest 8 bits of each of `count` values.
void to_8_bits(Packing packing, const std::uint8_t* in, std::size_t count, std::uint8_t* out) {
    const auto unpack16 = [&](int shift) {
        for (std::size_t i = 0; i < count; ++i)
            out[i] = static_cast<std::uint8_t>((in[2 * i] | in[2 * i + 1] << 8) >> shift);
    };
    switch (packing) {
        case Packing::k8:
            break;
        case Packing::k10:
            return unpack16(2);
        case Packing::k12:
            return unpack16(4);
        case Packing::k10Packed:
        case Packing::k12Packed:
            for (std::size_t i = 0; i < count; ++i) out[i] = in[i / 2 * 3 + (i % 2) * 2];
            return;
        case Packing::k12p:
            for (std::size_t i = 0; i < count; ++i) {
                const std::uint8_t* pair = in + i / 2 * 3;
                out[i] = i % 2 ? pair[2] : static_cast<std::uint8_t>(pair[0] >> 4 | pair[1] << 4);
            }
            return;
        case Packing::k10p:
            for (std::size_t i = 0; i < count; ++i) {
                const std::uint8_t* four = in + i / 4 * 5;
                const int at = static_cast<int>(i % 4);
                out[i] = static_cast<std::uint8_t>((four[at] | four[at + 1] << 8) >> (2 * at + 2));
            }
            return;
    }
}

// OpenCV names a pattern by its second row's second and third pixel.
int demosaicing(Layout layout) {
    switch (layout) {
        case Layout::kRggb:
            return cv::COLOR_BayerBG2BGR;
        case Layout::kGrbg:
            return cv::COLOR_BayerGB2BGR;
        case Layout::kGbrg:
            return cv::COLOR_BayerGR2BGR;
        case Layout::kBggr:
            return cv::COLOR_BayerRG2BGR;
        default:
            return -1;
    }
}

}  // namespace

bool is_known_pixel_format(std::uint32_t format) {
    return find(format).has_value();
}

std::size_t picture_bytes(std::uint32_t format, int width, int height) {
    if (!find(format)) return 0;
    const std::size_t bits = format >> 16 & 0xff;
    return (static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * bits + 7) / 8;
}

absl::Status to_bgr(std::uint32_t format, std::span<const std::uint8_t> bytes, int width, int height,
                    std::uint8_t* out) {
    const auto known = find(format);
    if (!known)
        return absl::InvalidArgumentError(fmt::format(
            "pixel format {:#010x} is not understood; set one of {}", format, kKnownPixelFormats));
    if (bytes.size() < picture_bytes(format, width, height))
        return absl::InvalidArgumentError(fmt::format("a picture of {} x {} px has {} bytes, {} are needed",
                                                      width, height, bytes.size(),
                                                      picture_bytes(format, width, height)));
    const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    auto* in = const_cast<std::uint8_t*>(bytes.data());  // cv::Mat knows no const; it is only read
    cv::Mat bgr(height, width, CV_8UC3, out);
    if (known->layout == Layout::kBgr) {
        std::copy_n(in, 3 * pixels, out);
        return absl::OkStatus();
    }
    if (known->layout == Layout::kRgb) {
        cv::cvtColor(cv::Mat(height, width, CV_8UC3, in), bgr, cv::COLOR_RGB2BGR);
        return absl::OkStatus();
    }
    thread_local std::vector<std::uint8_t> eight_bits;  // of the camera's thread, grown once
    if (known->packing != Packing::k8) {
        eight_bits.resize(pixels);
        to_8_bits(known->packing, in, pixels, eight_bits.data());
        in = eight_bits.data();
    }
    cv::cvtColor(
        cv::Mat(height, width, CV_8UC1, in), bgr,
        known->layout == Layout::kMono ? static_cast<int>(cv::COLOR_GRAY2BGR) : demosaicing(known->layout));
    return absl::OkStatus();
}

}  // namespace kinevox
