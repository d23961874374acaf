// A camera's pixels come out in their own colours, whichever way they are packed.
#include "server/cameras/aravis/pixel_format.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace kinevox {
namespace {

constexpr int kRowWidth = 16, kRows = 8;
constexpr std::uint8_t kBgr[3] = {40, 90, 200};

// 8-bit values packed by a camera with this bit depth; its lower bits are 1 and must be ignored.
std::vector<std::uint8_t> packed(const std::vector<std::uint8_t>& values, const std::string& packing) {
    std::vector<std::uint8_t> out;
    const int bits = packing == "8" ? 8 : packing.starts_with("10") ? 10 : 12;
    const auto value = [&](std::size_t i) { return ((values[i] + 1) << (bits - 8)) - 1; };
    if (packing == "8") return values;
    if (packing == "10" || packing == "12") {
        for (std::size_t i = 0; i < values.size(); ++i) {
            out.push_back(static_cast<std::uint8_t>(value(i)));
            out.push_back(static_cast<std::uint8_t>(value(i) >> 8));
        }
    } else if (packing == "10Packed" || packing == "12Packed") {
        for (std::size_t i = 0; i < values.size(); i += 2)
            out.insert(out.end(), {values[i], 0xff, values[i + 1]});
    } else {  // bits without gaps, low bits first
        out.resize(values.size() * bits / 8);
        for (std::size_t i = 0; i < values.size(); ++i)
            for (int b = 0; b < bits; ++b)
                if (value(i) >> b & 1)
                    out[(i * bits + b) / 8] |= static_cast<std::uint8_t>(1 << (i * bits + b) % 8);
    }
    return out;
}

// The colours of a sensor's first two rows, such as "RGGB".
std::vector<std::uint8_t> mosaic(const std::string& pattern) {
    std::vector<std::uint8_t> out;
    for (int y = 0; y < kRows; ++y)
        for (int x = 0; x < kRowWidth; ++x) {
            const char colour = pattern[(y % 2) * 2 + x % 2];
            out.push_back(kBgr[colour == 'B' ? 0 : colour == 'G' ? 1 : 2]);
        }
    return out;
}

TEST(PixelFormats, ConvertColoursCorrectly) {
    const struct {
        std::uint32_t format;
        const char *pattern, *packing;
    } kTable[] = {
        {0x01080008, "GRBG", "8"},        {0x01080009, "RGGB", "8"},        {0x0108000a, "GBRG", "8"},
        {0x0108000b, "BGGR", "8"},        {0x0110000c, "GRBG", "10"},       {0x0110000d, "RGGB", "10"},
        {0x0110000e, "GBRG", "10"},       {0x0110000f, "BGGR", "10"},       {0x01100010, "GRBG", "12"},
        {0x01100011, "RGGB", "12"},       {0x01100012, "GBRG", "12"},       {0x01100013, "BGGR", "12"},
        {0x010c0026, "GRBG", "10Packed"}, {0x010c0027, "RGGB", "10Packed"}, {0x010c0028, "GBRG", "10Packed"},
        {0x010c0029, "BGGR", "10Packed"}, {0x010c002a, "GRBG", "12Packed"}, {0x010c002b, "RGGB", "12Packed"},
        {0x010c002c, "GBRG", "12Packed"}, {0x010c002d, "BGGR", "12Packed"}, {0x010a0056, "GRBG", "10p"},
        {0x010a0058, "RGGB", "10p"},      {0x010a0054, "GBRG", "10p"},      {0x010a0052, "BGGR", "10p"},
        {0x010c0057, "GRBG", "12p"},      {0x010c0059, "RGGB", "12p"},      {0x010c0055, "GBRG", "12p"},
        {0x010c0053, "BGGR", "12p"},
    };
    for (const auto& row : kTable) {
        const auto bytes = packed(mosaic(row.pattern), row.packing);
        ASSERT_TRUE(is_known_pixel_format(row.format));
        ASSERT_EQ(bytes.size(), image_bytes(row.format, kRowWidth, kRows)) << row.pattern << row.packing;
        std::vector<std::uint8_t> bgr(3 * kRowWidth * kRows);
        ASSERT_TRUE(to_bgr(row.format, bytes, kRowWidth, kRows, bgr.data()).ok());
        for (std::size_t i = 0; i < bgr.size(); ++i)
            ASSERT_EQ(bgr[i], kBgr[i % 3]) << row.pattern << row.packing << " byte " << i;
    }
}

TEST(PixelFormats, PassGreyAndColourUnchanged) {
    std::vector<std::uint8_t> grey(kRowWidth * kRows), out(3 * kRowWidth * kRows);
    for (std::size_t i = 0; i < grey.size(); ++i) grey[i] = static_cast<std::uint8_t>(i + 3);
    for (const auto& [format, packing] :
         std::vector<std::pair<std::uint32_t, std::string>>{{0x01080001, "8"},
                                                            {0x01100003, "10"},
                                                            {0x01100005, "12"},
                                                            {0x010c0004, "10Packed"},
                                                            {0x010c0006, "12Packed"},
                                                            {0x010a0046, "10p"},
                                                            {0x010c0047, "12p"}}) {
        ASSERT_TRUE(to_bgr(format, packed(grey, packing), kRowWidth, kRows, out.data()).ok());
        for (std::size_t i = 0; i < out.size(); ++i) ASSERT_EQ(out[i], grey[i / 3]) << packing;
    }
    std::vector<std::uint8_t> colours(3 * kRowWidth * kRows), swapped(colours.size());
    for (std::size_t i = 0; i < colours.size(); ++i)
        swapped[i / 3 * 3 + 2 - i % 3] = colours[i] = static_cast<std::uint8_t>(i);
    ASSERT_TRUE(to_bgr(0x02180015, colours, kRowWidth, kRows, out.data()).ok());
    EXPECT_EQ(out, colours);
    ASSERT_TRUE(to_bgr(0x02180014, swapped, kRowWidth, kRows, out.data()).ok());
    EXPECT_EQ(out, colours);
}

TEST(PixelFormats, RejectUnknownFormats) {
    std::vector<std::uint8_t> bytes(64), out(3 * kRowWidth * kRows);
    EXPECT_FALSE(is_known_pixel_format(0x0210001f));  // YUV422
    EXPECT_TRUE(absl::IsInvalidArgument(to_bgr(0x0210001f, bytes, kRowWidth, kRows, out.data())));
    EXPECT_TRUE(absl::IsInvalidArgument(to_bgr(0x01080009, bytes, kRowWidth, kRows, out.data())))
        << "too few bytes";
}

}  // namespace
}  // namespace kinevox
