#include "server/cameras/aravis/discovery.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>

#include "server/cameras/aravis/aravis_handles.h"

namespace kinevox {

std::mutex& aravis_list_mutex() {
    static std::mutex mutex;  // one, as Aravis has one list
    return mutex;
}

namespace {

// Aravis opens a GigE camera by this name but does not list it, so it is read by GVCP (READMEM of the
// bootstrap register), which needs no control of the camera. Empty if it does not answer in time.
std::string user_name_of(const std::string& address) {
    constexpr std::uint16_t kControlPort = 3956;
    constexpr std::size_t kNameBytes = 16, kHeaderBytes = 8;
    // Acknowledge, READMEM, 8 bytes, number 1; register 0xe8, 16 bytes.
    static constexpr std::uint8_t kAsk[] = {0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 0, 0xe8, 0, 0, 0, kNameBytes};
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(kControlPort);
    if (inet_pton(AF_INET, address.c_str(), &to.sin_addr) != 1) return {};
    const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return {};
    std::string name;
    std::uint8_t answer[64];
    pollfd wait{fd, POLLIN, 0};
    if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0 &&
        send(fd, kAsk, sizeof kAsk, 0) > 0 && poll(&wait, 1, 100) == 1) {
        const ssize_t bytes = recv(fd, answer, sizeof answer, 0);
        const bool fine =
            bytes >= static_cast<ssize_t>(kHeaderBytes + 4 + kNameBytes) && answer[0] == 0 && answer[1] == 0;
        if (fine) {
            const auto* begin = reinterpret_cast<const char*>(answer) + kHeaderBytes + 4;
            name.assign(begin, std::find(begin, begin + kNameBytes, '\0'));
        }
    }
    close(fd);
    return name;
}

}  // namespace

std::vector<FoundCamera> discover_cameras() {
    const std::scoped_lock lock(aravis_list_mutex());
    arv_debug_enable("all:0");  // its messages are also returned as errors
    arv_update_device_list();
    std::vector<FoundCamera> found;
    for (unsigned i = 0; i < arv_get_n_devices(); ++i)
        found.push_back({text_of(arv_get_device_id(i)),
                         text_of(arv_get_device_physical_id(i)),
                         text_of(arv_get_device_address(i)),
                         text_of(arv_get_device_vendor(i)),
                         text_of(arv_get_device_model(i)),
                         text_of(arv_get_device_serial_nbr(i)),
                         {},
                         text_of(arv_get_device_protocol(i))});
    for (FoundCamera& camera : found)
        if (camera.protocol == "GigEVision") camera.user_name = user_name_of(camera.address);
    std::ranges::sort(found, {}, &FoundCamera::id);
    return found;
}

const FoundCamera* choose_camera(const std::vector<FoundCamera>& found, const std::string& device) {
    for (std::string FoundCamera::*key : {&FoundCamera::serial, &FoundCamera::user_name, &FoundCamera::id,
                                          &FoundCamera::address, &FoundCamera::physical_id})
        if (const auto at = std::ranges::find(found, device, key); at != found.end()) return &*at;
    return nullptr;
}

std::string describe(const FoundCamera& camera) {
    std::string text = fmt::format("{} {} {}", camera.vendor, camera.model, camera.serial);
    if (!camera.address.empty()) text += " at " + camera.address;
    return text;
}

}  // namespace kinevox
