#include "client/bridge/udp_sender.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <utility>

#include "common/host_port.h"

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
    const auto address = parse_host_port(to);
    if (!address || address->port == 0)
        return absl::InvalidArgumentError(
            fmt::format("\"{}\" is not HOST:PORT; give an address such as 127.0.0.1:39539", to));
    auto socket = std::make_unique<Socket>();
    boost::system::error_code error;
    const auto found = udp::resolver(socket->io).resolve(address->host, std::to_string(address->port), error);
    if (error || found.empty())
        return absl::NotFoundError(fmt::format("host {} cannot be resolved ({}); give an IP address",
                                               address->host, error.message()));
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
    ++(error ? dropped_ : sent_);  // also an error while no receiver listens
}

}  // namespace kinevox::bridge
