// Big-endian numbers into and out of packets.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace kinevox::testing {

class Wire {
  public:
    explicit Wire(std::vector<std::uint8_t>& out) : out_(out) {}
    Wire& u8(std::uint32_t v) {
        out_.push_back(static_cast<std::uint8_t>(v));
        return *this;
    }
    Wire& u16(std::uint32_t v) { return u8(v >> 8 & 0xff).u8(v & 0xff); }
    Wire& u32(std::uint32_t v) { return u16(v >> 16).u16(v & 0xffff); }
    Wire& bytes(std::span<const std::uint8_t> b) {
        out_.insert(out_.end(), b.begin(), b.end());
        return *this;
    }

  private:
    std::vector<std::uint8_t>& out_;
};

// 0 beyond the end.
inline std::uint32_t big_endian(std::span<const std::uint8_t> data, std::size_t at, int bytes) {
    std::uint32_t value = 0;
    for (int i = 0; i < bytes; ++i) value = value << 8 | (at + i < data.size() ? data[at + i] : 0);
    return value;
}

}  // namespace kinevox::testing
