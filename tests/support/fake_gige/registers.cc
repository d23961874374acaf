#include "tests/support/fake_gige/registers.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

namespace kinevox::testing {
namespace {

constexpr char kDescription[] =
#include "camera_xml.inc"
    ;

}  // namespace

Registers::Registers(std::uint32_t address, const std::string& serial, const std::string& name) {
    const std::size_t xml_bytes = sizeof kDescription - 1;
    memory_.resize((reg::kXml + xml_bytes + 1023) / 512 * 512);
    std::memcpy(memory_.data() + reg::kXml, kDescription, xml_bytes);
    set(0x0000, 0x00010002);  // GigE Vision 1.2
    set(0x0004, 0x80000001);  // big endian, UTF-8
    set(0x0008, 0x0000024b);  // MAC
    set(0x000c, address);
    set(0x0010, 0x00000006);
    set(0x0014, 0x00000005);  // persistent IP
    set(0x0024, address);
    set(0x0034, 0xff000000);
    text(0x0048, 32, "Kinevox");
    text(0x0068, 32, "Fake");
    text(0x0088, 32, "1.0");
    text(0x00a8, 48, "a program of the tests");
    text(0x00d8, 16, serial);
    text(0x00e8, 16, name);
    text(0x0200, 512, fmt::format("Local:fake.xml;{:x};{:x}", reg::kXml, xml_bytes));
    set(0x0600, 1);
    set(0x0904, 1);
    set(0x0934, 0x0000000f);  // packet resend, write memory, concatenation
    set(reg::kHeartbeatMs, 3000);
    set(0x0940, 1'000'000'000);  // ticks a second
    set(reg::kPacketSize, 1500);
    set(reg::kWidth, 640);
    set(reg::kHeight, 480);
    set(0x10098, 2048);
    set(0x1009c, 1536);
    set_double(reg::kFrameRate, 30);
    set_double(0x10030, 5000);
    for (const std::uint32_t ratio : {0x10070u, 0x10078u, 0x10080u}) set_double(ratio, 1);
    set(reg::kPixelFormat, 0x01080009);
}

void Registers::text(std::uint32_t address, std::size_t room, const std::string& text) {
    std::memcpy(memory_.data() + address, text.data(), std::min(room - 1, text.size()));
}

std::uint32_t Registers::get(std::uint32_t address) const {
    if (address % 4 != 0 || address + 4 > memory_.size()) return 0;
    std::uint32_t value = 0;
    for (int i = 0; i < 4; ++i) value = value << 8 | memory_[address + i];
    return value;
}

void Registers::set(std::uint32_t address, std::uint32_t value) {
    if (address % 4 != 0 || address + 4 > reg::kXml) return;
    for (int i = 0; i < 4; ++i) memory_[address + i] = static_cast<std::uint8_t>(value >> (24 - 8 * i));
    update_payload();
}

double Registers::get_double(std::uint32_t address) const {
    return std::bit_cast<double>(std::uint64_t{get(address)} << 32 | get(address + 4));
}

void Registers::set_double(std::uint32_t address, double value) {
    const auto bits = std::bit_cast<std::uint64_t>(value);
    set(address, static_cast<std::uint32_t>(bits >> 32));
    set(address + 4, static_cast<std::uint32_t>(bits));
}

std::span<const std::uint8_t> Registers::read(std::uint32_t address, std::size_t bytes) const {
    if (std::size_t{address} + bytes > memory_.size()) return {};
    return {memory_.data() + address, bytes};
}

bool Registers::write(std::uint32_t address, std::span<const std::uint8_t> bytes) {
    if (std::size_t{address} + bytes.size() > reg::kXml) return false;
    std::ranges::copy(bytes, memory_.begin() + address);
    update_payload();
    return true;
}

void Registers::update_payload() {
    const std::uint32_t payload =
        get(reg::kWidth) * get(reg::kHeight) * static_cast<std::uint32_t>(bits_per_pixel()) / 8;
    for (int i = 0; i < 4; ++i)
        memory_[reg::kPayloadSize + i] = static_cast<std::uint8_t>(payload >> (24 - 8 * i));
}

}  // namespace kinevox::testing
