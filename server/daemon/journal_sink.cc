#include "server/daemon/journal_sink.h"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "common/log_fields.h"

namespace kinevox {
namespace {

// syslog's priorities.
int priority_of(spdlog::level::level_enum level) {
    switch (level) {
        case spdlog::level::critical:
            return 2;
        case spdlog::level::err:
            return 3;
        case spdlog::level::warn:
            return 4;
        case spdlog::level::info:
            return 6;
        default:
            return 7;
    }
}

}  // namespace

bool stderr_is_journal() {
    const char* stream = std::getenv("JOURNAL_STREAM");
    struct stat now {};
    if (!stream || ::fstat(STDERR_FILENO, &now) != 0) return false;
    return fmt::format("{}:{}", static_cast<std::uint64_t>(now.st_dev),
                       static_cast<std::uint64_t>(now.st_ino)) == stream;
}

std::string journal_field(std::string_view name, std::string_view value) {
    if (value.find('\n') == std::string_view::npos) return fmt::format("{}={}\n", name, value);
    std::string field = fmt::format("{}\n", name);
    for (int byte = 0; byte < 8; ++byte)
        field += static_cast<char>(static_cast<std::uint64_t>(value.size()) >> (8 * byte));
    return field.append(value) + "\n";
}

JournalSink::JournalSink(std::filesystem::path socket)
    : path_(std::move(socket)), socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}

JournalSink::~JournalSink() {
    if (socket_ >= 0) ::close(socket_);
}

// By name each time: the journal may have been restarted.
bool JournalSink::send(const std::string& datagram) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path_.native().size() >= sizeof address.sun_path) return false;
    std::memcpy(address.sun_path, path_.c_str(), path_.native().size());
    return ::sendto(socket_, datagram.data(), datagram.size(), MSG_DONTWAIT | MSG_NOSIGNAL,
                    reinterpret_cast<const sockaddr*>(&address),
                    sizeof address) == static_cast<ssize_t>(datagram.size());
}

void JournalSink::sink_it_(const spdlog::details::log_msg& line) {
    const std::string_view message(line.payload.data(), line.payload.size());
    const int priority = priority_of(line.level);
    std::string datagram =
        journal_field("MESSAGE", message) + journal_field("PRIORITY", std::to_string(priority)) +
        journal_field("SYSLOG_IDENTIFIER", {line.logger_name.data(), line.logger_name.size()});
    for (const auto& [name, value] : LogFields::now()) datagram += journal_field(name, value);
    if (send(datagram)) return;
    const std::string plain =
        fmt::format("<{}>{}\n", priority, message);  // the journal reads the priority of such a line
    [[maybe_unused]] const ssize_t ignored = ::write(STDERR_FILENO, plain.data(), plain.size());
}

}  // namespace kinevox
