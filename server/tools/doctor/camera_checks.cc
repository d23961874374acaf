#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

constexpr long long kUsbMegabytes = 1000;  // of pending transfers of all cameras
constexpr long long kSuperSpeed = 5000;    // Mbit/s

const std::string kUsbDevices = "sys/bus/usb/devices/";

// "2-1" for a camera with the interface class of USB3 Vision (miscellaneous, 5).
std::vector<std::string> usb_cameras(const Machine& machine) {
    std::vector<std::string> out;
    for (const std::string& name : machine.names(kUsbDevices)) {  // an interface is "2-1:1.0"
        const auto colon = name.find(':');
        if (colon == std::string::npos || machine.text(kUsbDevices + name + "/bInterfaceClass") != "ef" ||
            machine.text(kUsbDevices + name + "/bInterfaceSubClass") != "05")
            continue;
        if (const std::string device = name.substr(0, colon); std::ranges::find(out, device) == out.end())
            out.push_back(device);
    }
    return out;
}

Finding usb_node(const Facts& facts, const std::string& device) {
    const std::string folder = kUsbDevices + device;
    const std::string node =
        fmt::format("dev/bus/usb/{:03}/{:03}", facts.machine.number(folder + "/busnum").value_or(0),
                    facts.machine.number(folder + "/devnum").value_or(0));
    if (access(facts.machine.at(node).c_str(), R_OK | W_OK) == 0)
        return {Severity::kOk, "USB permissions", fmt::format("the camera at USB {} may be opened", device)};
    return {Severity::kError,
            "USB permissions",
            fmt::format("/{}, the camera at USB {}, may not be opened by you", node, device),
            "install kinevox-server, which brings udev rules; be in the group plugdev; unplug and plug the "
            "camera",
            {{Fix::Kind::kUdev,
              "SUBSYSTEM==\"usb\", ENV{DEVTYPE}==\"usb_device\", ENV{ID_USB_INTERFACES}==\"*:ef0500:*\", "
              "MODE=\"0660\", GROUP=\"plugdev\", TAG+=\"uaccess\""}}};
}

Finding usb_speed(const Facts& facts, const std::string& device) {
    const auto speed = facts.machine.number(kUsbDevices + device + "/speed").value_or(0);
    if (speed >= kSuperSpeed)
        return {Severity::kOk, "USB speed",
                fmt::format("the camera at USB {} runs at {} Mbit/s", device, speed)};
    return {Severity::kError, "USB speed",
            fmt::format("the camera at USB {} runs at {} Mbit/s", device, speed),
            "plug it into a USB 3 port, without a hub, with a cable for USB 3"};
}

}  // namespace

Findings check_cameras(const Facts& facts) {
    const DaemonConfig config = facts.settings();
    Findings out;
    if (config.source.kind != SourceConfig::Kind::kCameras)
        return {
            {Severity::kOk, "cameras", fmt::format("none are configured; {} answered", facts.found.size())}};
    for (const LiveCameraConfig& camera : config.source.cameras.cameras) {
        if (const FoundCamera* found = choose_camera(facts.found, camera.device))
            out.push_back({Severity::kOk, "cameras", fmt::format("{} is {}", camera.name, describe(*found))});
        else
            out.push_back({Severity::kError, "cameras",
                           fmt::format("{} ({}) does not answer; {} others do", camera.name, camera.device,
                                       facts.found.size()),
                           "check cable and power, the interface's network and the firewall; "
                           "`kinevox discover` lists those that answer"});
    }
    return out;
}

Findings check_usb(const Facts& facts) {
    Findings out;
    const auto cameras = usb_cameras(facts.machine);
    for (const std::string& device : cameras) {
        out.push_back(usb_node(facts, device));
        out.push_back(usb_speed(facts, device));
    }
    const std::string memory = "sys/module/usbcore/parameters/usbfs_memory_mb";
    const auto megabytes = facts.machine.number(memory);
    if (!megabytes) {
        if (!cameras.empty())
            out.push_back({Severity::kWarning, "USB memory", "/" + memory + " cannot be read",
                           "run this outside of a container"});
    } else if (*megabytes == 0 || *megabytes >= kUsbMegabytes) {
        out.push_back({Severity::kOk, "USB memory", fmt::format("usbfs_memory_mb is {}", *megabytes)});
    } else {
        out.push_back({cameras.empty() ? Severity::kOk : Severity::kError, "USB memory",
                       fmt::format("usbfs_memory_mb is {}{}", *megabytes,
                                   cameras.empty() ? "; USB cameras would need more"
                                                   : ", too little for a camera's pending images"),
                       cameras.empty() ? "" : fmt::format("echo {} > /{}", kUsbMegabytes, memory),
                       cameras.empty()
                           ? std::vector<Fix>{}
                           : std::vector<Fix>{{Fix::Kind::kTmpfile,
                                               fmt::format("w /{} - - - - {}", memory, kUsbMegabytes)}}});
    }
    return out;
}

}  // namespace kinevox::doctor
