// Parts of reading the daemon's configuration.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>

#include "common/toml_reader.h"
#include "kernels/device.h"
#include "kernels/option_list.h"
#include "server/config/daemon_config.h"

namespace kinevox {

kernels::Device device_or(const TomlTable& table, const char* key, kernels::Device fallback);

// Reads options from a TOML table by their list (kernels/option_list.h). Paths are relative to `folder`.
template <typename Options>
void read_options(const TomlTable& table, const std::filesystem::path& folder, Options& options) {
    visit_options(options, [&](const kernels::OptionInfo& info, auto& value) {
        using Value = std::remove_cvref_t<decltype(value)>;
        if constexpr (std::is_same_v<Value, bool>)
            value = table.boolean_or(info.key, value);
        else if constexpr (std::is_enum_v<Value>)
            value = static_cast<Value>(
                table.choice_index_or(info.key, static_cast<std::size_t>(value), info.choices));
        else if constexpr (std::is_same_v<Value, kernels::Device>)
            value = device_or(table, info.key, value);
        else if constexpr (std::is_same_v<Value, std::string>)
            value = info.choices.empty()
                        ? table.text_or(info.key, value)
                        : table.choice_or(info.key, value, {info.choices.begin(), info.choices.end()});
        else if constexpr (std::is_same_v<Value, std::filesystem::path> ||
                           std::is_same_v<Value, OptionalPath>) {
            const std::string text = table.text_or(info.key, "");
            if (table.has(info.key))
                value = text.empty() ? std::filesystem::path() : (folder / text).lexically_normal();
        } else if constexpr (std::is_integral_v<Value>)
            value = static_cast<Value>(table.integer_or(info.key, value, static_cast<std::int64_t>(info.min),
                                                        static_cast<std::int64_t>(info.max)));
        else
            value = static_cast<Value>(
                table.number_or(info.key, static_cast<double>(value), {info.min, info.max}));
    });
}

// Records an error unless the file exists or its path is empty.
void require_file(const TomlTable& table, const char* key, const std::filesystem::path& file,
                  std::string_view remedy);

// Reads [source.cameras]; `required`: the source is these cameras, so nothing may be missing.
void read_live_cameras(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                       bool required, LiveSourceConfig& cameras);

}  // namespace kinevox
