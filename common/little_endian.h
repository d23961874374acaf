// Whole numbers as bytes, the lowest first, whatever the machine's own order.
#pragma once

#include <concepts>
#include <cstddef>
#include <string>
#include <string_view>
#include <type_traits>

namespace kinevox {

template <std::integral T>
void put_little_endian(std::string& to, T value) {
    for (std::size_t i = 0; i < sizeof(T); ++i)
        to += static_cast<char>(static_cast<std::make_unsigned_t<T>>(value) >> (8 * i) & 0xff);
}

// The number that `from`, at least as long, begins with; it is taken off.
template <std::unsigned_integral T>
T take_little_endian(std::string_view& from) {
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i)
        value |= static_cast<T>(static_cast<T>(static_cast<unsigned char>(from[i])) << (8 * i));
    from.remove_prefix(sizeof(T));
    return value;
}

}  // namespace kinevox
