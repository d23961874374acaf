// Cameras on the network or on USB: their discovery, and the source of their frame sets.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <string>
#include <vector>

#include "common/live_camera_config.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct FoundCamera {
    std::string id;           // assigned by Aravis from vendor, model and serial number
    std::string physical_id;  // MAC address or equivalent
    std::string address;      // IP address; USB: empty or the bus
    std::string vendor, model, serial;
    std::string user_name;  // user-defined name; GigE Vision only
    std::string protocol;   // "GigEVision" or "USB3Vision"
};

// Broadcasts on every network interface and waits about a second for answers. Any thread; concurrent calls
// run one after the other.
std::vector<FoundCamera> discover_cameras();

// The camera with this serial number, user-defined name, IP address, MAC address or Aravis id; null if none.
const FoundCamera* choose_camera(const std::vector<FoundCamera>& found, const std::string& device);

// "Kinevox Fake F1 at 127.0.0.1"
std::string describe(const FoundCamera& camera);

// Reads the calibration, which defines order, names and sizes: NotFound or InvalidArgument name the file and
// the camera it lacks. Accesses no camera: from the first next() on, a thread per camera finds, configures
// and reads it, and reconnects after a disconnection. An absent camera is an event and a state, not an error.
absl::StatusOr<std::unique_ptr<FrameSource>> open_live_source(const LiveSourceConfig& config);

}  // namespace kinevox
