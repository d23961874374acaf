// Reads options from a TOML table by their list (kernels/option_list.h).
#pragma once

#include <cstdint>
#include <type_traits>

#include "common/toml_reader.h"
#include "kernels/option_list.h"

namespace kinevox {

template <typename Options>
void read_options(const TomlTable& table, Options& options) {
    visit_options(options, [&](const kernels::OptionInfo& info, auto& value) {
        using Value = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, bool>)
            value = table.boolean_or(info.key, value);
        else if constexpr (std::is_integral_v<Value>)
            value = static_cast<Value>(table.integer_or(info.key, value, static_cast<std::int64_t>(info.min),
                                                        static_cast<std::int64_t>(info.max)));
        else
            value = static_cast<Value>(
                table.number_or(info.key, static_cast<double>(value), {info.min, info.max}));
    });
}

}  // namespace kinevox
