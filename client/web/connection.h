// One connection: requests, and the WebSocket that one of them may become. Boost inside: for gateway.cc
// alone.
#pragma once

#include <boost/asio/awaitable.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <memory>
#include <utility>  // which Asio's awaitable.hpp of Boost 1.74 forgets; so it stands first

#include "client/web/gateway.h"
#include "client/web/outbox.h"

namespace kinevox::web {

// A WebSocket and what waits for it.
struct Browser {
    explicit Browser(boost::beast::tcp_stream&& stream)
        : socket(std::move(stream)), wake(socket.get_executor()) {}

    boost::beast::websocket::stream<boost::beast::tcp_stream> socket;
    boost::asio::steady_timer wake;  // cancelled when there is something to write
    Outbox outbox;
    Clock::time_point writing_since{};  // zero: nothing is being written
    Clock::time_point window_begin{};   // of counting its messages
    int messages_in_window = 0, misunderstood = 0;
    bool closing = false;
    boost::beast::websocket::close_code why = boost::beast::websocket::close_code::normal;

    void close(boost::beast::websocket::close_code code);
    void put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t lost);
    void answer(const web::v1::GatewayMessage& message);  // closes the socket of one that does not read
    void cut();                                           // at once, without a word
};

// What a connection needs of the gateway.
class House {
  public:
    virtual ~House() = default;
    virtual const GatewayOptions& options() const = 0;
    virtual const Pages& pages() const = 0;
    virtual bool admit(const std::shared_ptr<Browser>& browser) = 0;  // false: too many
    virtual void wants_changed() = 0;
    virtual void leave(const std::shared_ptr<Browser>& browser) = 0;
};

boost::asio::awaitable<void> serve(House& house, boost::asio::ip::tcp::socket socket);

}  // namespace kinevox::web
