// The checks of `kinevox doctor`. Each looks at one thing, changes nothing, and says what it saw.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "common/config.h"
#include "server/cameras/aravis/discovery.h"
#include "server/tools/doctor/finding.h"
#include "server/tools/doctor/machine.h"

namespace kinevox::doctor {

using Findings = std::vector<Finding>;

// What is known before the checks begin.
struct Facts {
    Machine machine;
    std::filesystem::path config_file;  // empty: none, the defaults count
    absl::StatusOr<DaemonConfig> config = DaemonConfig{};
    std::vector<FoundCamera> found;                  // that answered
    std::filesystem::path state_folder, recordings;  // of the service, or of whoever asks; empty: none
    std::uint64_t disk_test_bytes = std::uint64_t{256} << 20;

    // The configuration, or the defaults where it cannot be read.
    DaemonConfig settings() const { return config.ok() ? *config : DaemonConfig{}; }
};

Findings check_config(const Facts& facts);   // readable, without errors
Findings check_cameras(const Facts& facts);  // those of the configuration answer
Findings check_usb(const Facts& facts);      // permissions, speed and memory for USB3 Vision
Findings check_network(const Facts& facts);  // receive buffers, backlog
Findings check_camera_interfaces(
    const Facts& facts);  // MTU, speed and path filter of those with cameras behind them
Findings check_gpu(const Facts& facts);
Findings check_memory(const Facts& facts);  // huge pages
Findings check_limits(const Facts& facts);  // open files
Findings check_clock(const Facts& facts);
Findings check_state(const Facts& facts);  // the folder of the service's state
Findings check_disk(const Facts& facts);   // space and speed where recordings go; writes a file there
Findings check_port(const Facts& facts);

Findings check_all(const Facts& facts);

}  // namespace kinevox::doctor
