// Which cameras there are on the network and on USB.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <vector>

namespace kinevox {

struct FoundCamera {
    std::string id;           // Aravis', of maker, model and serial number
    std::string physical_id;  // MAC or the like
    std::string address;      // IP; of USB: empty or the bus
    std::string vendor, model, serial;
    std::string user_name;  // that somebody gave it; of GigE Vision cameras only
    std::string protocol;   // "GigEVision" or "USB3Vision"
};

// Asks on every network interface and waits for the answers, about a second. One at a time: others wait. Any
// thread.
std::vector<FoundCamera> discover_cameras();

// The one that `device` means: serial number, user's name, address, MAC or Aravis' id. Null: none of them.
const FoundCamera* choose_camera(const std::vector<FoundCamera>& found, const std::string& device);

// "Kinevox Fake F1 at 127.0.0.1"
std::string describe(const FoundCamera& camera);

}  // namespace kinevox
