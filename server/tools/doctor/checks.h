// The checks of `kinevox doctor`. Each examines one subject and changes nothing.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "server/cameras/aravis/discovery.h"
#include "server/config/daemon_config.h"
#include "server/tools/doctor/finding.h"
#include "server/tools/doctor/machine.h"

namespace kinevox::doctor {

using Findings = std::vector<Finding>;

// Input of the checks.
struct Facts {
    Machine machine;
    std::filesystem::path config_file;  // empty: none, defaults apply
    absl::StatusOr<DaemonConfig> config = DaemonConfig{};
    std::vector<FoundCamera> found;                  // cameras that answered
    std::filesystem::path state_folder, recordings;  // of the service or the user; empty: none
    std::uint64_t disk_test_bytes = std::uint64_t{256} << 20;

    // The configuration, or the defaults if it cannot be read.
    DaemonConfig settings() const { return config.ok() ? *config : DaemonConfig{}; }
};

Findings check_config(const Facts& facts);   // readable, without errors
Findings check_cameras(const Facts& facts);  // those of the configuration answer
Findings check_usb(const Facts& facts);      // permissions, speed and memory for USB3 Vision
Findings check_network(const Facts& facts);  // receive buffers, backlog

struct Interface {
    std::string name;
    std::uint32_t address = 0, mask = 0;  // IPv4, in host byte order
};
std::vector<Interface> interfaces();  // of this machine, with an IPv4 address
// Those in whose network a camera answered.
std::vector<Interface> with_cameras(const std::vector<Interface>& all,
                                    const std::vector<FoundCamera>& cameras);
// MTU, speed and path filter.
Findings check_interfaces(const Facts& facts, const std::vector<Interface>& interfaces);
Findings check_camera_interfaces(const Facts& facts);  // of those with cameras

Findings check_gpu(const Facts& facts);
Findings check_memory(const Facts& facts);  // huge pages
Findings check_limits(const Facts& facts);  // open files

struct ClockState {
    bool known = false, synchronised = false;
    double error_ms = 0;  // the kernel's estimate
};
ClockState clock_state();
Finding judge(const ClockState& clock);
Findings check_clock(const Facts& facts);

Findings check_state(const Facts& facts);  // the folder of the service's state
Findings check_disk(const Facts& facts);   // space and speed where recordings go; writes a file there
Findings check_port(const Facts& facts);

Findings check_all(const Facts& facts);

}  // namespace kinevox::doctor
