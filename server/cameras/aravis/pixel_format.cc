#include "server/cameras/aravis/pixel_format.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

namespace kinevox {
namespace {

enum class Layout { kMono, kRggb, kGrbg, kGbrg, kBggr, kRgb, kBgr };
// Memory layout of one channel.
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

// PFNC codes (GenICam Pixel Format Naming Convention).
struct NamedFormat {
    std::uint32_t code;
    Format format;
};
constexpr NamedFormat kFormats[] = {
    {0x01080001, {Layout::kMono, Packing::k8}},        {0x01100003, {Layout::kMono, Packing::k10}},
    {0x010c0004, {Layout::kMono, Packing::k10Packed}}, {0x01100005, {Layout::kMono, Packing::k12}},
    {0x010c0006, {Layout::kMono, Packing::k12Packed}}, {0x010a0046, {Layout::kMono, Packing::k10p}},
    {0x010c0047, {Layout::kMono, Packing::k12p}},      {0x01080008, {Layout::kGrbg, Packing::k8}},
    {0x01080009, {Layout::kRggb, Packing::k8}},        {0x0108000a, {Layout::kGbrg, Packing::k8}},
    {0x0108000b, {Layout::kBggr, Packing::k8}},        {0x0110000c, {Layout::kGrbg, Packing::k10}},
    {0x0110000d, {Layout::kRggb, Packing::k10}},       {0x0110000e, {Layout::kGbrg, Packing::k10}},
    {0x0110000f, {Layout::kBggr, Packing::k10}},       {0x01100010, {Layout::kGrbg, Packing::k12}},
    {0x01100011, {Layout::kRggb, Packing::k12}},       {0x01100012, {Layout::kGbrg, Packing::k12}},
    {0x01100013, {Layout::kBggr, Packing::k12}},       {0x010c0026, {Layout::kGrbg, Packing::k10Packed}},
    {0x010c0027, {Layout::kRggb, Packing::k10Packed}}, {0x010c0028, {Layout::kGbrg, Packing::k10Packed}},
    {0x010c0029, {Layout::kBggr, Packing::k10Packed}}, {0x010c002a, {Layout::kGrbg, Packing::k12Packed}},
    {0x010c002b, {Layout::kRggb, Packing::k12Packed}}, {0x010c002c, {Layout::kGbrg, Packing::k12Packed}},
    {0x010c002d, {Layout::kBggr, Packing::k12Packed}}, {0x010a0056, {Layout::kGrbg, Packing::k10p}},
    {0x010a0058, {Layout::kRggb, Packing::k10p}},      {0x010a0054, {Layout::kGbrg, Packing::k10p}},
    {0x010a0052, {Layout::kBggr, Packing::k10p}},      {0x010c0057, {Layout::kGrbg, Packing::k12p}},
    {0x010c0059, {Layout::kRggb, Packing::k12p}},      {0x010c0055, {Layout::kGbrg, Packing::k12p}},
    {0x010c0053, {Layout::kBggr, Packing::k12p}},      {0x02180014, {Layout::kRgb, Packing::k8}},
    {0x02180015, {Layout::kBgr, Packing::k8}}};

std::optional<Format> find(std::uint32_t code) {
    for (const NamedFormat& known : kFormats)
        if (known.code == code) return known.format;
    return std::nullopt;
}

// The upper 8 bits of each of `count` values.
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

std::size_t image_bytes(std::uint32_t format, int width, int height) {
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
    if (bytes.size() < image_bytes(format, width, height))
        return absl::InvalidArgumentError(fmt::format("an image of {} x {} px has {} bytes, {} are needed",
                                                      width, height, bytes.size(),
                                                      image_bytes(format, width, height)));
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
