#include "common/loopback.h"

#include <arpa/inet.h>

#include "common/host_port.h"

namespace kinevox {

bool is_loopback(const std::string& host_and_port) {
    const auto address = parse_host_port(host_and_port);
    const std::string& host = address ? address->host : host_and_port;
    if (host == "localhost") return true;
    in_addr v4{};
    if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return ntohl(v4.s_addr) >> 24 == 127;
    in6_addr v6{};
    return inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

}  // namespace kinevox
