// [source.cameras] of the daemon's configuration: cameras on the network or on USB; deploy/kinevoxd.toml
// explains every key.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox {

class TomlTable;

// What is not given stays as the camera has it.
struct CameraSettings {
    std::string pixel_format;           // GenICam's name: Mono8, BayerRG8, BayerRG12p, RGB8, BGR8, ...
    std::optional<double> exposure_us;  // 1 to 1e6; switches the automatic off
    std::optional<double> gain_db;      // -20 to 100; the same
    std::string white_balance;          // "off", "once", "continuous"
    std::optional<std::array<double, 3>>
        white_balance_ratios;                     // red, green, blue; 0.05 to 20; switches the automatic off
    std::optional<std::array<int, 2>> offset_px;  // where on the sensor the picture begins: x, y
    bool operator==(const CameraSettings&) const = default;
};

struct LiveCameraConfig {
    std::string name;         // in the calibration
    std::string device;       // serial number, address, MAC, the user's name for it, or Aravis' id
    CameraSettings settings;  // those of all cameras, with its own over them
    bool operator==(const LiveCameraConfig&) const = default;
};

struct LiveCamerasConfig {
    enum class Trigger {
        kFree,      // each by itself
        kSoftware,  // a command from this machine to each at the same moment
        kExternal,  // a generator's pulses on trigger_line
        kMaster,    // the master runs by itself, its exposure line triggers the others
    };
    std::filesystem::path calibration;  // absolute after reading
    double fps = 30;                    // 1 to 1000; of the generator with kExternal
    Trigger trigger = Trigger::kSoftware;
    std::string trigger_line = "Line1";
    std::string master;                 // its name; for kMaster
    std::string master_line = "Line2";  // its output
    bool ptp = false;                   // switch PTP on where a camera has it
    double tolerance_ms = 0;   // pictures so near belong together; 0: half a period, with kFree 0.9 of it
    double max_wait_ms = 200;  // for a picture that is missing in a set, 1 to 5000
    int min_cameras = 2;       // a set with fewer pictures is not used
    int queue = 8;             // sets that may wait for the pipeline; then the oldest goes, 1 to 64
    bool packet_resend = true;
    int packet_bytes = 0;  // 576 to 16000; 0: the largest that gets through
    std::vector<LiveCameraConfig> cameras;
    bool operator==(const LiveCamerasConfig&) const = default;
};

// Reads the table; `required`: these are the cameras that are asked for, so that nothing may be missing.
void read_live_cameras(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                       bool required, LiveCamerasConfig& cameras);

}  // namespace kinevox
