#pragma once

#include <concepts>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace kinevox {

// `value` as T; empty if it is no integer or out of T's range. nlohmann's get() converts silently: out of
// range it returns another number, and for a fraction the result is undefined.
template <std::integral T>
std::optional<T> exact_integer(const nlohmann::ordered_json& value) {
    const auto fitting = [](auto number) {
        return std::in_range<T>(number) ? std::optional(static_cast<T>(number)) : std::nullopt;
    };
    if (value.is_number_unsigned()) return fitting(value.get<std::uint64_t>());
    return value.is_number_integer() ? fitting(value.get<std::int64_t>()) : std::nullopt;
}

}  // namespace kinevox
