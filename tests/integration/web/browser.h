// A blocking WebSocket client with a deadline for each read.
#pragma once

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <functional>
#include <optional>
#include <string>

#include "kinevox/web/v1/exhibit.pb.h"
#include "tests/support/patience.h"

namespace kinevox::testing {

class TestBrowser {
  public:
    explicit TestBrowser(const std::string& address, const std::string& origin = "") : socket_(io_) {
        const std::size_t colon = address.rfind(':');
        const auto host = address.substr(0, colon);
        auto& tcp = boost::beast::get_lowest_layer(socket_);
        tcp.socket().connect({boost::asio::ip::make_address(host),
                              static_cast<std::uint16_t>(std::stoi(address.substr(colon + 1)))},
                             error);
        if (error) return;
        socket_.set_option(boost::beast::websocket::stream_base::decorator(
            [&](boost::beast::websocket::request_type& request) {
                if (!origin.empty()) request.set(boost::beast::http::field::origin, origin);
            }));
        socket_.handshake(address, "/ws", error);
        socket_.binary(true);
    }

    void send(const std::string& bytes) { socket_.write(boost::asio::buffer(bytes), error); }
    void send_text(const std::string& text) {
        socket_.binary(false);
        send(text);
    }
    void subscribe(const std::vector<web::v1::StreamSubscription>& subscriptions) {
        web::v1::BrowserMessage message;
        for (const web::v1::StreamSubscription& subscription : subscriptions)
            *message.add_subscriptions() = subscription;
        send(message.SerializeAsString());
    }
    static web::v1::StreamSubscription subscription(web::v1::StreamKind kind, const std::string& camera = "",
                                                    int downsample_level = 0) {
        web::v1::StreamSubscription out;
        out.set_kind(kind);
        out.set_camera(camera);
        out.set_downsample_level(downsample_level);
        return out;
    }

    // The next message; empty after `limit` or at the end of the connection (sets `error`).
    std::optional<web::v1::GatewayMessage> read(
        std::chrono::milliseconds limit = testing::patient(std::chrono::seconds(20))) {
        boost::beast::flat_buffer buffer;
        bool done = false;
        socket_.async_read(buffer, [&](boost::system::error_code e, std::size_t) { done = true, error = e; });
        io_.restart();
        io_.run_for(limit);
        if (!done) boost::beast::get_lowest_layer(socket_).cancel(), io_.restart(), io_.run();
        if (error) return {};
        web::v1::GatewayMessage message;
        const auto bytes = buffer.data();
        if (!message.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return {};
        return message;
    }

    // The first message for which `good` holds; empty if none arrives in time.
    std::optional<web::v1::GatewayMessage> wait_for(
        const std::function<bool(const web::v1::GatewayMessage&)>& good,
        std::chrono::seconds limit = testing::patient(std::chrono::seconds(20))) {
        const auto end = std::chrono::steady_clock::now() + limit;
        while (std::chrono::steady_clock::now() < end) {
            auto message = read(limit);
            if (!message) return {};
            if (good(*message)) return message;
        }
        return {};
    }
    std::optional<web::v1::GatewayMessage> wait_for(web::v1::GatewayMessage::PayloadCase kind) {
        return wait_for(
            [kind](const web::v1::GatewayMessage& message) { return message.payload_case() == kind; });
    }

    boost::beast::websocket::close_code closed_with() const {
        return static_cast<boost::beast::websocket::close_code>(socket_.reason().code);
    }
    boost::system::error_code error;

  private:
    boost::asio::io_context io_;
    boost::beast::websocket::stream<boost::beast::tcp_stream> socket_;
};

}  // namespace kinevox::testing
