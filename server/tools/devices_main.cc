// kinevox devices: the CPU and the GPUs of this machine, by the names that `--device` and the configuration
// use.
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "common/command_line.h"
#include "kernels/device_facts.h"
#include "server/tools/devices/device_report.h"

int main(int argc, char** argv) {
    bool json = false;
    CLI::App app(
        "List the devices that can compute on this machine: the CPU and each GPU, with its state and the "
        "remedy if it "
        "is unusable (executes a small kernel on each GPU).",
        "kinevox devices");
    app.add_flag("--json", json, "Print one JSON object");
    return kinevox::tool_main(app, argc, argv, [&] {
        const kinevox::kernels::CpuFacts cpu = kinevox::kernels::cpu_facts();
        const kinevox::kernels::CudaFacts cuda = kinevox::kernels::cuda_facts();
        if (json) {
            fmt::print("{}\n", kinevox::device_json(cpu, cuda));
        } else {
            fmt::print("{}", kinevox::device_table(cpu, cuda));
        }
        return absl::OkStatus();
    });
}
