// The devices that compute, and their names: "cpu", "cuda" (the first GPU) and "cuda:N".
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace kinevox::kernels {

// The CPU, or one of the GPUs in CUDA's order.
class Device {
  public:
    static const Device kCpu, kCuda;  // kCuda: the first GPU

    constexpr Device() = default;  // the CPU
    // `index` from 0 on.
    static constexpr Device cuda(int index) {
        Device device;
        device.index_ = index;
        return device;
    }

    constexpr bool is_cuda() const { return index_ >= 0; }
    constexpr int index() const { return index_; }  // of a GPU
    bool operator==(const Device&) const = default;

  private:
    int index_ = -1;
};

inline constexpr Device Device::kCpu{};
inline constexpr Device Device::kCuda = Device::cuda(0);

// "cpu" or "cuda:N".
std::string name_of(Device device);

// Empty if no device has that name; whether the machine has the GPU is not checked.
std::optional<Device> device_of_name(std::string_view name);

// Allowed names and how to list the machine's, for the error about another name.
inline constexpr const char* kDeviceNames = "cpu, cuda or cuda:N; `kinevox devices` lists them";

}  // namespace kinevox::kernels
