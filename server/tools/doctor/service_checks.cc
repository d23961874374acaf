#include <fmt/format.h>
#include <netdb.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <system_error>

#include "common/host_port.h"
#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

// 0, or the error of listening there.
int listen_error(const std::string& host, const std::string& port) {
    addrinfo hints{}, *list = nullptr;
    hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(host.c_str(), port.c_str(), &hints, &list) != 0 || !list) return EADDRNOTAVAIL;
    const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> owned(list, freeaddrinfo);
    const int socket = ::socket(list->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (socket < 0) return errno;
    const int yes = 1;
    setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes,
               sizeof yes);  // ignores closing connections
    const int error = bind(socket, list->ai_addr, list->ai_addrlen) == 0 ? 0 : errno;
    close(socket);
    return error;
}

}  // namespace

Findings check_config(const Facts& facts) {
    if (!facts.config.ok())
        return {{Severity::kError, "configuration", std::string(facts.config.status().message()),
                 "correct it; the daemon does not start without"}};
    if (facts.config_file.empty()) return {{Severity::kOk, "configuration", "none; defaults apply"}};
    struct stat of {};
    if (stat(facts.config_file.c_str(), &of) == 0 && (of.st_mode & S_IWOTH))
        return {{Severity::kError,
                 "configuration",
                 facts.config_file.string() + " may be written by everybody",
                 "chmod o-w " + facts.config_file.string(),
                 {{Fix::Kind::kCommand, "chmod o-w '" + facts.config_file.string() + "'"}}}};
    return {{Severity::kOk, "configuration", facts.config_file.string() + " has no errors"}};
}

Findings check_port(const Facts& facts) {
    const std::string listen = facts.settings().server.listen;
    const HostPort address = parse_host_port(listen).value_or(HostPort{});  // the configuration was checked
    const int error = listen_error(address.host, std::to_string(address.port));
    const int daemon = facts.machine.process("kinevoxd");
    if (error == 0)
        return {{Severity::kOk, "port",
                 listen + (daemon ? " is free, though a kinevoxd runs: it listens elsewhere" : " is free")}};
    if (error == EADDRINUSE && daemon)
        return {
            {Severity::kOk, "port", fmt::format("kinevoxd (process {}) runs, {} is taken", daemon, listen)}};
    if (error == EADDRINUSE)
        return {{Severity::kError, "port", listen + " is taken by another program",
                 "see `ss -ltnp`; give [server] listen another port"}};
    return {{Severity::kError, "port", fmt::format("{}: {}", listen, std::generic_category().message(error)),
             "give [server] listen an address of this machine, and a port above 1023"}};
}

Findings check_all(const Facts& facts) {
    Findings out;
    for (const auto check :
         {check_config, check_port, check_cameras, check_camera_interfaces, check_network, check_usb,
          check_gpu, check_memory, check_limits, check_clock, check_state, check_disk})
        for (Finding& finding : check(facts)) out.push_back(std::move(finding));
    return out;
}

}  // namespace kinevox::doctor
