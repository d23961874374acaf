#include <arpa/inet.h>
#include <fmt/format.h>
#include <ifaddrs.h>

#include <algorithm>
#include <map>
#include <memory>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

constexpr long long kReceiveBytes = 33554432;  // docs/cameras.md: the daemon requests 8 MB per camera
constexpr long long kBacklog = 5000;     // packets; one gigabit of 1500-byte packets is 80 per millisecond
constexpr long long kJumboBytes = 8192;  // from which packets count as jumbo frames

bool has_network_cameras(const Facts& facts) {
    return std::ranges::any_of(facts.found,
                               [](const FoundCamera& camera) { return camera.protocol == "GigEVision"; });
}

Finding at_least(const Facts& facts, const char* check, const std::string& key, long long min_value,
                 const char* why) {
    std::string path = "proc/sys/" + key;
    std::ranges::replace(path, '.', '/');
    const auto value = facts.machine.number(path);
    if (!value)
        return {Severity::kWarning, check, fmt::format("{} cannot be read", key),
                "run this outside of a container"};
    if (*value >= min_value) return {Severity::kOk, check, fmt::format("{} is {}", key, *value)};
    // Without network cameras nothing is lost yet.
    return {has_network_cameras(facts) ? Severity::kError : Severity::kWarning,
            check,
            fmt::format("{} is {}, below {}: {}", key, *value, min_value, why),
            fmt::format("sysctl -w {}={}", key, min_value),
            {{Fix::Kind::kSysctl, fmt::format("{}={}", key, min_value)}}};
}

Finding mtu_of(const Facts& facts, const Interface& interface) {
    const auto mtu = facts.machine.number("sys/class/net/" + interface.name + "/mtu").value_or(0);
    if (mtu >= kJumboBytes)
        return {Severity::kOk, "jumbo frames", fmt::format("{} has an MTU of {} bytes", interface.name, mtu)};
    return {Severity::kWarning,
            "jumbo frames",
            fmt::format("{}, which connects cameras, has an MTU of {} bytes: six times as many "
                        "interrupts as with 9000",
                        interface.name, mtu),
            fmt::format("ip link set {} mtu 9000, and the same on the switch", interface.name),
            {{Fix::Kind::kCommand, fmt::format("ip link set {} mtu 9000", interface.name)},
             {Fix::Kind::kUdev,
              fmt::format("ACTION==\"add\", SUBSYSTEM==\"net\", KERNEL==\"{}\", ATTR{{mtu}}=\"9000\"",
                          interface.name)}}};
}

Finding speed_of(const Facts& facts, const Interface& interface) {
    const auto megabits = facts.machine.number("sys/class/net/" + interface.name + "/speed").value_or(-1);
    if (megabits < 0) return {Severity::kOk, "network speed", interface.name + " reports no speed"};
    if (megabits >= 1000)
        return {Severity::kOk, "network speed",
                fmt::format("{} runs at {} Mbit/s", interface.name, megabits)};
    return {Severity::kError, "network speed",
            fmt::format("{}, which connects cameras, runs at {} Mbit/s", interface.name, megabits),
            "use a cable and a port of 1 Gbit/s or more"};
}

// 1 drops packets from addresses that this interface would not route to; the kernel uses the larger value.
Finding path_filter_of(const Facts& facts, const Interface& interface) {
    const std::string folder = "proc/sys/net/ipv4/conf/";
    const auto filter = std::max(facts.machine.number(folder + "all/rp_filter").value_or(0),
                                 facts.machine.number(folder + interface.name + "/rp_filter").value_or(0));
    if (filter != 1)
        return {Severity::kOk, "path filter", fmt::format("{} has rp_filter {}", interface.name, filter)};
    return {Severity::kWarning,
            "path filter",
            fmt::format("{} has rp_filter 1: cameras without an address of its network are not found",
                        interface.name),
            fmt::format("sysctl -w net.ipv4.conf.{}.rp_filter=2", interface.name),
            {{Fix::Kind::kSysctl, fmt::format("net.ipv4.conf.{}.rp_filter=2", interface.name)}}};
}

}  // namespace

std::vector<Interface> interfaces() {
    ifaddrs* list = nullptr;
    if (getifaddrs(&list) != 0) return {};
    const std::unique_ptr<ifaddrs, decltype(&freeifaddrs)> owned(list, freeifaddrs);
    std::vector<Interface> out;
    for (const ifaddrs* one = list; one; one = one->ifa_next) {
        if (!one->ifa_addr || one->ifa_addr->sa_family != AF_INET || !one->ifa_netmask) continue;
        const auto number = [](const sockaddr* address) {
            return ntohl(reinterpret_cast<const sockaddr_in*>(address)->sin_addr.s_addr);
        };
        out.push_back({one->ifa_name, number(one->ifa_addr), number(one->ifa_netmask)});
    }
    return out;
}

std::vector<Interface> with_cameras(const std::vector<Interface>& all,
                                    const std::vector<FoundCamera>& cameras) {
    std::map<std::string, Interface> out;
    for (const FoundCamera& camera : cameras) {
        in_addr address{};
        if (camera.protocol != "GigEVision" || inet_pton(AF_INET, camera.address.c_str(), &address) != 1)
            continue;
        for (const Interface& interface : all)
            if ((ntohl(address.s_addr) & interface.mask) == (interface.address & interface.mask))
                out.insert({interface.name, interface});
    }
    std::vector<Interface> list;
    for (auto& [name, interface] : out) list.push_back(std::move(interface));
    return list;
}

Findings check_network(const Facts& facts) {
    return {at_least(facts, "receive buffers", "net.core.rmem_max", kReceiveBytes,
                     "images lose packets in bursts"),
            at_least(facts, "packet backlog", "net.core.netdev_max_backlog", kBacklog,
                     "packets are dropped while a core is busy")};
}

Findings check_interfaces(const Facts& facts, const std::vector<Interface>& interfaces) {
    Findings out;
    for (const Interface& interface : interfaces) {
        out.push_back(mtu_of(facts, interface));
        out.push_back(speed_of(facts, interface));
        out.push_back(path_filter_of(facts, interface));
    }
    return out;
}

Findings check_camera_interfaces(const Facts& facts) {
    return check_interfaces(facts, with_cameras(interfaces(), facts.found));
}

}  // namespace kinevox::doctor
