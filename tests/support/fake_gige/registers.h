// The fake camera's registers: GigE Vision's bootstrap registers, the features of camera_xml.py, and that
// description itself.
#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

namespace kinevox::testing {

namespace reg {
inline constexpr std::uint32_t kHeartbeatMs = 0x938, kControl = 0xa00, kStreamPort = 0xd00,
                               kPacketSize = 0xd04, kStreamAddress = 0xd18;
inline constexpr std::uint32_t kWidth = 0x10000, kHeight = 0x10004, kOffsetX = 0x10008, kOffsetY = 0x1000c,
                               kPixelFormat = 0x10010, kPayloadSize = 0x10014, kAcquisition = 0x10018,
                               kFrameRate = 0x10020, kTriggerMode = 0x10050, kTriggerSource = 0x10054,
                               kTriggerSoftware = 0x10058, kPtpEnable = 0x10090, kPtpStatus = 0x10094,
                               kLineMode = 0x100a4, kFrameRateEnable = 0x100b4;
inline constexpr std::uint32_t kXml = 0x20000;
}  // namespace reg

class Registers {
  public:
    // `address`: the camera's own IPv4, host byte order.
    Registers(std::uint32_t address, const std::string& serial, const std::string& name);

    std::uint32_t get(std::uint32_t address) const;
    void set(std::uint32_t address, std::uint32_t value);
    double get_double(std::uint32_t address) const;
    void set_double(std::uint32_t address, double value);
    // Empty where there is nothing.
    std::span<const std::uint8_t> read(std::uint32_t address, std::size_t bytes) const;
    bool write(std::uint32_t address, std::span<const std::uint8_t> bytes);

    // Bits of a pixel in the format chosen, as its number says.
    int bits_per_pixel() const { return static_cast<int>(get(reg::kPixelFormat) >> 16 & 0xff); }

  private:
    void text(std::uint32_t address, std::size_t room, const std::string& text);
    void update_payload();
    std::vector<std::uint8_t> memory_;
};

}  // namespace kinevox::testing
