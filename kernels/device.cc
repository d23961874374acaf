#include "kernels/device.h"

#include <charconv>
#include <system_error>

namespace kinevox::kernels {

std::string name_of(Device device) {
    return device.is_cuda() ? "cuda:" + std::to_string(device.index()) : "cpu";
}

std::optional<Device> device_of_name(std::string_view name) {
    constexpr std::string_view kPrefix = "cuda:";
    constexpr int kMaxIndex = 999;
    if (name == "cpu") return Device::kCpu;
    if (name == "cuda") return Device::kCuda;
    if (!name.starts_with(kPrefix)) return std::nullopt;
    const std::string_view digits = name.substr(kPrefix.size());
    int index = -1;
    const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), index);
    if (error != std::errc() || end != digits.data() + digits.size() || index < 0 || index > kMaxIndex)
        return std::nullopt;
    const Device device = Device::cuda(index);
    return name_of(device) == name ? std::optional(device) : std::nullopt;  // not "cuda:01", "cuda:-0"
}

}  // namespace kinevox::kernels
