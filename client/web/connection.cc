#include "client/web/connection.h"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <limits>

namespace kinevox::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::system::error_code;

constexpr std::uint32_t kMaxHeader_bytes = 8192;
constexpr int kSendBuffer_bytes = 64 << 10;
constexpr std::size_t kMaxDrain_bytes = 1 << 20;
constexpr std::chrono::milliseconds kMaxDrainTime{1'000};
constexpr int kMaxMessages_per_s = 30, kMaxInvalidMessages = 8;

auto to(error_code& e) {
    return asio::redirect_error(asio::use_awaitable, e);
}

using Parser = http::request_parser<http::empty_body>;

HttpRequest request_of(const Parser& parser) {
    const auto& message = parser.get();
    const auto text = [&](http::field field) { return std::string(message[field]); };
    HttpRequest request{std::string(message.method_string()), std::string(message.target()),
                        text(http::field::host), text(http::field::origin), text(http::field::if_none_match)};
    request.upgrade = websocket::is_upgrade(message);
    request.host_count = static_cast<int>(message.count(http::field::host));
    request.has_body = !parser.is_done();
    return request;
}

// The body refers to the page's memory, which outlives the connection.
asio::awaitable<bool> send(beast::tcp_stream& stream, const HttpReply& reply, bool keep_alive,
                           error_code& e) {
    const std::string& content = reply.page ? reply.page->content : reply.text;
    http::response<http::span_body<const char>> response(static_cast<http::status>(reply.status), 11);
    for (const auto& [name, value] : reply.headers) response.set(name, value);
    response.keep_alive(keep_alive);
    if (reply.body) response.body() = {content.data(), content.size()};
    if (reply.status != 304) response.content_length(content.size());
    http::response_serializer<http::span_body<const char>> serializer(response);
    if (reply.body)
        co_await http::async_write(stream, serializer, to(e));
    else
        co_await http::async_write_header(stream, serializer, to(e));
    co_return !e && keep_alive;
}

void handle_message(GatewayContext& gateway, Browser& browser, std::string_view bytes) {
    const SubscriptionRequest request = parse_subscriptions(bytes);
    for (const v1::StreamError& error : request.errors) {
        v1::GatewayMessage message;
        *message.mutable_error() = error;
        browser.reply(message);
    }
    if (!request.valid) {
        if (++browser.invalid_messages >= kMaxInvalidMessages)
            browser.close(websocket::close_code::policy_error);
        return;
    }
    browser.outbox.subscribe(request.accepted);
    gateway.subscriptions_changed();
}

bool exceeds_rate(Browser& browser) {
    const Clock::time_point now = Clock::now();
    if (now - browser.window_begin > std::chrono::seconds(1)) {
        browser.window_begin = now;
        browser.messages_in_window = 0;
    }
    return ++browser.messages_in_window > kMaxMessages_per_s;
}

asio::awaitable<void> write_to(std::shared_ptr<Browser> browser) {
    error_code e;
    while (!e && !browser->closing) {
        std::optional<Outgoing> out = browser->outbox.take();
        if (!out) {
            browser->wake.expires_at(Clock::time_point::max());
            co_await browser->wake.async_wait(to(e));
            e = {};
            continue;
        }
        const std::array<asio::const_buffer, 2> pieces{asio::buffer(out->head), asio::buffer(*out->body)};
        browser->writing_since = Clock::now();
        co_await browser->socket.async_write(pieces, to(e));
        browser->writing_since = {};
    }
    if (!e && browser->close_code != websocket::close_code::none) {
        const websocket::close_reason reason(browser->close_code);
        co_await browser->socket.async_close(reason, to(e));
    }
    browser->disconnect();
}

asio::awaitable<void> run_browser(GatewayContext& gateway, std::shared_ptr<Browser> browser) {
    asio::co_spawn(browser->socket.get_executor(), write_to(browser), asio::detached);
    error_code e;
    for (;;) {
        beast::flat_buffer buffer(kMaxBrowserMessage_bytes);
        co_await browser->socket.async_read(buffer, to(e));
        if (e) break;
        if (browser->closing) continue;  // wait for the browser's close frame
        const auto bytes = buffer.data();
        if (!browser->socket.got_binary())
            browser->close(websocket::close_code::unknown_data);
        else if (exceeds_rate(*browser))
            browser->close(websocket::close_code::policy_error);
        else
            handle_message(gateway, *browser, {static_cast<const char*>(bytes.data()), bytes.size()});
    }
    gateway.remove(browser);
    browser->close(websocket::close_code::none);  // ends the writer
}

asio::awaitable<void> upgrade(GatewayContext& gateway, beast::tcp_stream& stream, const Parser& parser) {
    stream.expires_never();  // the WebSocket has its own timeouts
    const auto browser = std::make_shared<Browser>(std::move(stream));
    auto& socket = browser->socket;
    websocket::stream_base::timeout timeouts{gateway.options().request_timeout,
                                             gateway.options().idle_timeout, true};
    socket.set_option(timeouts);
    socket.read_message_max(kMaxBrowserMessage_bytes);
    socket.binary(true);
    socket.auto_fragment(false);
    error_code e;
    co_await socket.async_accept(parser.get(), to(e));
    if (e) co_return;
    if (!gateway.admit(browser)) {
        const websocket::close_reason full(websocket::close_code::try_again_later);
        co_await socket.async_close(full, to(e));
        co_return;
    }
    co_await run_browser(gateway, browser);
}

// Closes the connection. What the client still sends is read and discarded for up to a second: closing a
// socket with unread bytes resets the connection, and the client may lose the reply.
asio::awaitable<void> finish(beast::tcp_stream& stream) {
    error_code e;
    stream.socket().shutdown(asio::ip::tcp::socket::shutdown_send, e);
    std::array<char, 4096> discarded{};
    stream.expires_after(kMaxDrainTime);
    for (std::size_t bytes = 0; !e && bytes < kMaxDrain_bytes;)
        bytes += co_await stream.async_read_some(asio::buffer(discarded), to(e));
}

}  // namespace

void Browser::close(websocket::close_code code) {
    if (!closing) close_code = code;
    closing = true;
    wake.cancel();
}

void Browser::put(const Topic& topic, const std::shared_ptr<const std::string>& body,
                  std::uint64_t dropped_count) {
    outbox.put(topic, body, dropped_count, Clock::now());
    wake.cancel();
}

void Browser::reply(const v1::GatewayMessage& message) {
    if (!outbox.reply(message.SerializeAsString())) disconnect();
    wake.cancel();
}

void Browser::disconnect() {
    closing = true;
    error_code ignored;
    beast::get_lowest_layer(socket).socket().close(ignored);
    wake.cancel();
}

asio::awaitable<void> serve(GatewayContext& gateway, asio::ip::tcp::socket socket,
                            std::shared_ptr<void> half_open) {
    error_code e;
    socket.set_option(asio::ip::tcp::no_delay(true), e);
    // A small system buffer: what is queued there is old when it arrives, the outbox holds the latest.
    socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer_bytes), e);
    beast::tcp_stream stream(std::move(socket));
    beast::flat_buffer buffer(2 * kMaxHeader_bytes);
    for (bool again = true; again;) {
        Parser parser;
        parser.header_limit(kMaxHeader_bytes);
        parser.body_limit(std::numeric_limits<std::uint64_t>::max());  // bodies are never read
        stream.expires_after(gateway.options().request_timeout);
        co_await http::async_read_header(stream, buffer, parser, to(e));
        if (e == http::error::header_limit || e == http::error::buffer_overflow) {
            const HttpReply reply{431, {}, "the request header is too large\n"};
            co_await send(stream, reply, false, e);
            break;
        }
        if (e) break;
        half_open.reset();
        const HttpRequest request = request_of(parser);
        std::optional<HttpReply> rejection;
        if (request.upgrade) {
            rejection = reject_socket(request, gateway.options().rules);
            if (!rejection) {
                co_await upgrade(gateway, stream, parser);
                co_return;
            }
        }
        const HttpReply reply =
            rejection ? *std::move(rejection) : answer(request, gateway.pages(), gateway.options().rules);
        stream.expires_after(gateway.options().write_timeout);
        const bool keep_alive = parser.get().keep_alive() && !request.upgrade && !request.has_body;
        again = co_await send(stream, reply, keep_alive, e);
    }
    co_await finish(stream);
}

}  // namespace kinevox::web
