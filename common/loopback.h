// Which addresses never leave this machine.
#pragma once

#include <string>

namespace kinevox {

// Of HOST:PORT, [HOST]:PORT with IPv6: localhost, 127.0.0.0/8 and ::1. Names are not resolved.
bool is_loopback(const std::string& host_and_port);

}  // namespace kinevox
