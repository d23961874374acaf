// Parts of reading the daemon's configuration.
#pragma once

#include <cstdint>
#include <filesystem>
#include <type_traits>

#include "common/toml_reader.h"
#include "kernels/option_list.h"
#include "server/config/daemon_config.h"

namespace kinevox {

// Reads options from a TOML table by their list (kernels/option_list.h).
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

// Reads [source.cameras]; `required`: the source is these cameras, so nothing may be missing.
void read_live_cameras(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                       bool required, LiveSourceConfig& cameras);

}  // namespace kinevox
