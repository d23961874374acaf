#include "client/bridge/udp_sender.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <charconv>
#include <utility>

namespace kinevox::bridge {

using boost::asio::ip::udp;

struct UdpSender::Socket {
    boost::asio::io_context io;
    udp::socket socket{io};
    udp::endpoint to;
};

UdpSender::UdpSender(std::unique_ptr<Socket> socket) : socket_(std::move(socket)) {}
UdpSender::~UdpSender() = default;
UdpSender::UdpSender(UdpSender&&) noexcept = default;

absl::StatusOr<UdpSender> UdpSender::open(const std::string& to) {
    const std::size_t colon = to.rfind(':');
    int port = 0;
    const char* const end = to.data() + to.size();
    if (colon == std::string::npos || colon == 0 ||
        std::from_chars(to.data() + colon + 1, end, port).ptr != end || port < 1 || port > 65535)
        return absl::InvalidArgumentError(
            fmt::format("\"{}\" is no HOST:PORT; give one, 127.0.0.1:39539 say", to));
    auto socket = std::make_unique<Socket>();
    boost::system::error_code error;
    std::string host = to.substr(0, colon);
    if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);  // IPv6
    const auto found = udp::resolver(socket->io).resolve(host, std::to_string(port), error);
    if (error || found.empty())
        return absl::NotFoundError(
            fmt::format("{} is not known in this network ({}); give an address", host, error.message()));
    socket->to = found.begin()->endpoint();
    socket->socket.open(socket->to.protocol(), error);
    if (!error) socket->socket.set_option(udp::socket::broadcast(true), error);
    if (!error) socket->socket.non_blocking(true, error);
    if (error) return absl::UnavailableError(fmt::format("no socket for {}: {}", to, error.message()));
    return UdpSender(std::move(socket));
}

void UdpSender::send(std::span<const char> datagram) {
    boost::system::error_code error;
    socket_->socket.send_to(boost::asio::buffer(datagram.data(), datagram.size()), socket_->to, 0, error);
    ++(error ? dropped_ : sent_);  // nobody listening shows as an error, too, and passes
}

}  // namespace kinevox::bridge
