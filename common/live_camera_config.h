// [source.cameras] of the daemon's configuration: network and USB cameras; deploy/kinevoxd.toml documents
// every key, and server/config/daemon_config.h lists the numbers and switches with their ranges.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox {

// A setting that is not given stays as the camera has it.
struct CameraSettings {
    std::string pixel_format;           // GenICam's name: Mono8, BayerRG8, BayerRG12p, RGB8, BGR8, ...
    std::optional<double> exposure_us;  // 1 to 1e6; switches automatic exposure off
    std::optional<double> gain_db;      // -20 to 100; switches automatic gain off
    std::string white_balance;          // "off", "once", "continuous"
    std::optional<std::array<double, 3>>
        white_balance_ratios;  // red, green, blue; 0.05 to 20; switches automatic white balance off
    std::optional<std::array<int, 2>> sensor_offset_px;  // origin of the image on the sensor: x, y
    bool operator==(const CameraSettings&) const = default;
};

struct LiveCameraConfig {
    std::string name;         // in the calibration
    std::string device;       // serial number, user-defined name, IP address, MAC address or Aravis id
    CameraSettings settings;  // those of all cameras, overridden by its own
    bool operator==(const LiveCameraConfig&) const = default;
};

struct LiveSourceConfig {
    enum class Trigger {
        kFreeRun,   // each camera by itself
        kSoftware,  // a command from this machine to each camera at the same time
        kExternal,  // a generator's pulses on trigger_input_line
        kCamera,    // trigger_camera runs freely, its trigger_output_line triggers the others
    };
    std::filesystem::path calibration_file;  // absolute after reading
    double fps = 30;
    Trigger trigger = Trigger::kSoftware;
    std::string trigger_input_line = "Line1";
    std::string trigger_camera;  // its name; for kCamera
    std::string trigger_output_line = "Line2";
    bool ptp = false;
    double match_tolerance_ms = 0;
    double max_wait_ms = 200;
    int min_cameras = 2;
    int max_queued_frame_sets = 8;
    bool packet_resend = true;
    int packet_size_bytes = 0;
    std::vector<LiveCameraConfig> cameras;
    bool operator==(const LiveSourceConfig&) const = default;
};

}  // namespace kinevox
