// Options that are set by name. Each Options struct lists its members once, beside their defaults, in
//     visit_options(options, f), which calls f(OptionInfo, member) for each of them in a fixed order;
// the configuration reader, its documentation, the checks and a run's fingerprint come from that list.
#pragma once

#include <concepts>
#include <sstream>
#include <string>
#include <type_traits>

namespace kinevox::kernels {

struct OptionInfo {
    const char* key = "";
    double min = 0, max = 0;  // both allowed; without meaning for a bool
    const char* unit = "";    // "" for a count or a fraction
    const char* help = "";    // one sentence
};

// `T` is `Options` or `const Options`.
template <typename T, typename Options>
concept SameOptions = std::same_as<std::remove_const_t<T>, Options>;

// Empty if every option is within its range, else one sentence about the first that is not.
template <typename Options>
std::string check_ranges(const Options& options) {
    std::string problem;
    visit_options(options, [&](const OptionInfo& info, const auto& value) {
        using Value = std::remove_cvref_t<decltype(value)>;
        if constexpr (!std::is_same_v<Value, bool>) {
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
