#pragma once

#include <concepts>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace kinevox {

// The whole number that `value` is; nothing where it is something else or does not fit into T. nlohmann's own
// get() converts any number: beyond T's range another number comes out, and from one with a fraction the
// result is undefined.
template <std::integral T>
std::optional<T> whole_number(const nlohmann::ordered_json& value) {
    const auto fitting = [](auto number) {
        return std::in_range<T>(number) ? std::optional(static_cast<T>(number)) : std::nullopt;
    };
    if (value.is_number_unsigned()) return fitting(value.get<std::uint64_t>());
    return value.is_number_integer() ? fitting(value.get<std::int64_t>()) : std::nullopt;
}

}  // namespace kinevox
