#include "server/tools/devices/device_report.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <nlohmann/json.hpp>
#include <vector>

namespace kinevox {
namespace {

using kernels::CpuFacts;
using kernels::CudaFacts;
using kernels::GpuFacts;
using Json = nlohmann::ordered_json;

constexpr const char* kRow = "{:<8} {:<20} {:<11} {:<18} {}\n";  // device, memory, capability, state, name

std::string memory_text(const GpuFacts& gpu) {
    const auto gib = [](std::uint64_t bytes) {
        return static_cast<double>(bytes) / (std::uint64_t{1} << 30);
    };
    if (gpu.total_bytes == 0) return "-";
    if (!gpu.usable()) return fmt::format("{:.1f} GiB", gib(gpu.total_bytes));
    return fmt::format("{:.1f} of {:.1f} GiB", gib(gpu.free_bytes), gib(gpu.total_bytes));
}

std::string capability_text(const GpuFacts& gpu) {
    return gpu.capability_major == 0 ? "-" : fmt::format("{}.{}", gpu.capability_major, gpu.capability_minor);
}

std::string cpu_text(const CpuFacts& cpu) {
    return fmt::format(
        "{}, {} logical cores, {}", cpu.model.empty() ? "unknown model" : cpu.model, cpu.logical_cores,
        cpu.instruction_sets.empty() ? "neither AVX2 nor AVX-512"
                                     : fmt::format("{}", fmt::join(cpu.instruction_sets, ", ")));
}

Json null_if_empty(const std::string& text) {
    return text.empty() ? Json() : Json(text);
}

Json to_json(const GpuFacts& gpu) {
    return {{"device", kernels::name_of(gpu.device)},
            {"name", gpu.name},
            {"pci_bus_id", gpu.pci_bus_id},
            {"compute_capability", capability_text(gpu)},
            {"multiprocessors", gpu.multiprocessors},
            {"memory_total_bytes", gpu.total_bytes},
            {"memory_free_bytes", gpu.usable() ? Json(gpu.free_bytes) : Json()},
            {"usable", gpu.usable()},
            {"problem", null_if_empty(gpu.problem)},
            {"remedy", null_if_empty(gpu.remedy)}};
}

}  // namespace

std::string device_table(const CpuFacts& cpu, const CudaFacts& cuda) {
    const kernels::Device recommended = kernels::recommended_device(cuda);
    const auto state = [&](kernels::Device device, bool usable) {
        return !usable ? "unusable" : device == recommended ? "recommended" : "usable";
    };
    std::string text = fmt::format(kRow, "device", "free memory", "capability", "state", "name");
    text += fmt::format(kRow, "cpu", "-", "-", state(kernels::Device::kCpu, true), cpu_text(cpu));
    for (const GpuFacts& gpu : cuda.gpus)
        text += fmt::format(kRow, kernels::name_of(gpu.device), memory_text(gpu), capability_text(gpu),
                            state(gpu.device, gpu.usable()), gpu.name.empty() ? "unknown GPU" : gpu.name);
    for (const GpuFacts& gpu : cuda.gpus)
        if (!gpu.usable())
            text += fmt::format("{}: {}; {}\n", kernels::name_of(gpu.device), gpu.problem, gpu.remedy);
    if (!cuda.problem.empty()) text += fmt::format("no GPU: {}; {}\n", cuda.problem, cuda.remedy);
    if (!cuda.gpus.empty())
        text +=
            fmt::format("CUDA {}; the driver supports up to {}\n", cuda.runtime_version, cuda.driver_version);
    return text;
}

std::string device_json(const CpuFacts& cpu, const CudaFacts& cuda) {
    Json gpus = Json::array();
    for (const GpuFacts& gpu : cuda.gpus) gpus.push_back(to_json(gpu));
    const Json all = {{"recommended", kernels::name_of(kernels::recommended_device(cuda))},
                      {"cpu",
                       {{"device", "cpu"},
                        {"model", cpu.model},
                        {"logical_cores", cpu.logical_cores},
                        {"instruction_sets", cpu.instruction_sets}}},
                      {"cuda",
                       {{"runtime_version", null_if_empty(cuda.runtime_version)},
                        {"driver_version", null_if_empty(cuda.driver_version)},
                        {"problem", null_if_empty(cuda.problem)},
                        {"remedy", null_if_empty(cuda.remedy)}}},
                      {"gpus", gpus}};
    return all.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace kinevox
