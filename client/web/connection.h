// One connection: HTTP requests, and the WebSocket that a request may upgrade to. Exposes Boost: included by
// gateway.cc only.
#pragma once

// clang-format off: awaitable.hpp of Boost 1.74 uses std::exchange without including <utility>
#include <utility>
// clang-format on

#include <boost/asio/awaitable.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <memory>

#include "client/web/gateway.h"
#include "client/web/subscriptions.h"

namespace kinevox::web {

// A WebSocket and the messages queued for it.
struct Browser {
    explicit Browser(boost::beast::tcp_stream&& stream)
        : socket(std::move(stream)), wake(socket.get_executor()) {}

    boost::beast::websocket::stream<boost::beast::tcp_stream> socket;
    boost::asio::steady_timer wake;  // cancelled to wake the writer
    Outbox outbox;
    Clock::time_point writing_since{};  // zero: nothing is being written
    Clock::time_point window_begin{};   // for the rate limit
    int messages_in_window = 0, invalid_messages = 0;
    bool closing = false;
    boost::beast::websocket::close_code close_code = boost::beast::websocket::close_code::normal;

    void close(boost::beast::websocket::close_code code);
    void put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t dropped_count);
    void reply(const web::v1::GatewayMessage& message);  // disconnects a browser that does not read
    void disconnect();                                   // at once, without a close frame
};

// What a connection needs of the gateway.
class GatewayContext {
  public:
    virtual ~GatewayContext() = default;
    virtual const GatewayOptions& options() const = 0;
    virtual const Pages& pages() const = 0;
    virtual bool admit(const std::shared_ptr<Browser>& browser) = 0;  // false: too many
    virtual void subscriptions_changed() = 0;
    virtual void remove(const std::shared_ptr<Browser>& browser) = 0;
};

// `half_open` is released when the first request has arrived.
boost::asio::awaitable<void> serve(GatewayContext& gateway, boost::asio::ip::tcp::socket socket,
                                   std::shared_ptr<void> half_open);

}  // namespace kinevox::web
