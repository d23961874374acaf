// Network interfaces, and which of them have cameras behind them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {

struct Interface {
    std::string name;
    std::uint32_t address = 0, mask = 0;  // IPv4, in the host's order of bytes
};

std::vector<Interface> interfaces();  // of this machine, with an IPv4 address
// Those in whose network a camera answered.
std::vector<Interface> with_cameras(const std::vector<Interface>& all,
                                    const std::vector<FoundCamera>& cameras);
Findings check_interfaces(const Facts& facts, const std::vector<Interface>& interfaces);

}  // namespace kinevox::doctor
