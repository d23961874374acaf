#include "tests/cuda/emulator/settings.h"

#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace cuda_emulator {
namespace {

std::string variable(const char* name) {
    const char* value = std::getenv(name);
    return value ? value : "";
}

Settings read_settings() {
    Settings out;
    const std::string order = variable("KINEVOX_EMULATOR_ORDER");
    if (order == "reverse") {
        out.order = Order::kReverse;
    } else if (order.starts_with("random")) {
        out.order = Order::kRandom;
        if (order.size() > 7) out.seed = static_cast<std::uint32_t>(std::atoi(order.c_str() + 7));
    } else if (!order.empty() && order != "forward") {
        fail("KINEVOX_EMULATOR_ORDER is '" + order + "'; use forward, reverse or random[:SEED]");
    }
    const std::string poison = variable("KINEVOX_EMULATOR_POISON");
    if (!poison.empty()) out.poison = static_cast<unsigned char>(std::atoi(poison.c_str()));
    out.deferred = !variable("KINEVOX_EMULATOR_DEFERRED").empty();
    out.guarded = !variable("KINEVOX_EMULATOR_GUARDED").empty();
    const std::string devices = variable("KINEVOX_EMULATOR_DEVICES");
    if (!devices.empty()) out.devices = std::atoi(devices.c_str());
    out.profile = !variable("KINEVOX_EMULATOR_PROFILE").empty();
    return out;
}

}  // namespace

const Settings& settings() {
    static const Settings only = read_settings();
    return only;
}

void fail(const std::string& what) {
    std::fprintf(stderr, "CUDA emulator: %s\n", what.c_str());
    std::abort();
}

}  // namespace cuda_emulator
