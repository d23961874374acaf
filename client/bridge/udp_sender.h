// Datagrams to one address. One that cannot be sent immediately is dropped and counted.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace kinevox::bridge {

class UdpSender {
  public:
    // `to`: HOST:PORT, a name or an address; a broadcast address is allowed. InvalidArgument, NotFound.
    static absl::StatusOr<UdpSender> open(const std::string& to);
    ~UdpSender();
    UdpSender(UdpSender&&) noexcept;

    void send(std::span<const char> datagram);
    std::uint64_t sent() const { return sent_; }
    std::uint64_t dropped() const { return dropped_; }

  private:
    struct Socket;
    explicit UdpSender(std::unique_ptr<Socket> socket);
    std::unique_ptr<Socket> socket_;
    std::uint64_t sent_ = 0, dropped_ = 0;
};

}  // namespace kinevox::bridge
