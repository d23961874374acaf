// Addresses as HOST:PORT, with IPv6 as [HOST]:PORT.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace kinevox {

struct HostPort {
    std::string host;  // without brackets
    int port = 0;      // 0 to 65535

    std::string to_string() const;  // an IPv6 host in brackets
};

// Nothing where the host is empty, holds blanks, control characters or '/', is IPv6 without brackets, or the
// port is not a number from 0 to 65535. Names are not resolved.
std::optional<HostPort> parse_host_port(std::string_view text);

// The host of HOST:PORT or of HOST alone, without the brackets of IPv6.
std::string host_of(std::string_view text);

// Whether an address never leaves this machine: of HOST:PORT or HOST: localhost, 127.0.0.0/8 and ::1. Names
// are not resolved.
bool is_loopback(const std::string& host_and_port);

}  // namespace kinevox
