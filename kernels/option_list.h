// Options that are set by name. Each Options struct lists its members once, beside their defaults, in
//     visit_options(options, f), which calls f(OptionInfo, member) for each of them in a fixed order;
// the configuration reader, its documentation, the checks and a run's fingerprint come from that list.
#pragma once

#include <concepts>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <type_traits>

namespace kinevox::kernels {

struct OptionInfo {
    const char* key = "";
    double min = 0, max = 0;  // of a number, both allowed
    const char* unit = "";    // "" for a count or a fraction
    const char* help = "";    // one sentence
    // Allowed texts; of an enum the names of its values, in their order. Empty: any text.
    std::span<const std::string_view> choices{};
};

// Of an option that is a text, a path or an enum.
inline OptionInfo text_option(const char* key, const char* help,
                              std::span<const std::string_view> choices = {}) {
    return {key, 0, 0, "", help, choices};
}

// A number, which has a range; a bool, a text, a path or an enum has none.
template <typename Value>
inline constexpr bool kIsNumber = std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>;

// `T` is `Options` or `const Options`.
template <typename T, typename Options>
concept SameOptions = std::same_as<std::remove_const_t<T>, Options>;

// Empty if every number is within its range, else one sentence about the first that is not.
template <typename Options>
std::string check_ranges(const Options& options) {
    std::string problem;
    visit_options(options, [&](const OptionInfo& info, const auto& value) {
        using Value = std::remove_cvref_t<decltype(value)>;
        if constexpr (kIsNumber<Value>) {
            const Value min = static_cast<Value>(info.min), max = static_cast<Value>(info.max);
            if (!problem.empty() || (value >= min && value <= max)) return;  // NaN is out of range
            std::ostringstream text;
            text << info.key << " is " << value << "; " << min << " to " << max << " is allowed";
            problem = text.str();
        }
    });
    return problem;
}

}  // namespace kinevox::kernels
