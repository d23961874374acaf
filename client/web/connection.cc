#include "client/web/connection.h"

#include <array>
#include <boost/asio/buffer.hpp>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

namespace kinevox::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using boost::system::error_code;

constexpr std::uint32_t kMaxHead_bytes = 8192;
constexpr int kSendBuffer_bytes = 64 << 10;
constexpr int kMaxMessagesASecond = 30, kMaxMisunderstood = 8;

auto to(error_code& e) {
    return asio::redirect_error(asio::use_awaitable, e);
}

using Parser = http::request_parser<http::empty_body>;

HttpRequest plain_request(const Parser& parser) {
    const auto& message = parser.get();
    const auto text = [&](http::field field) { return std::string(message[field]); };
    HttpRequest request{std::string(message.method_string()), std::string(message.target()),
                        text(http::field::host), text(http::field::origin), text(http::field::if_none_match)};
    request.upgrade = websocket::is_upgrade(message);
    return request;
}

// The body is the page's own memory, which outlives the connection.
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

void hear(House& house, Browser& browser, std::string_view bytes) {
    const Wants wants = read_wants(bytes);
    for (const v1::Refusal& refusal : wants.refused) {
        v1::GatewayMessage message;
        *message.mutable_refusal() = refusal;
        browser.answer(message);
    }
    if (!wants.understood) {
        if (++browser.misunderstood >= kMaxMisunderstood) browser.close(websocket::close_code::policy_error);
        return;
    }
    browser.outbox.subscribe(wants.granted);
    house.wants_changed();
}

bool too_many(Browser& browser) {
    const Clock::time_point now = Clock::now();
    if (now - browser.window_begin > std::chrono::seconds(1)) {
        browser.window_begin = now;
        browser.messages_in_window = 0;
    }
    return ++browser.messages_in_window > kMaxMessagesASecond;
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
    if (!e && browser->why != websocket::close_code::none) {
        const websocket::close_reason reason(browser->why);
        co_await browser->socket.async_close(reason, to(e));
    }
    browser->cut();
}

asio::awaitable<void> talk(House& house, std::shared_ptr<Browser> browser) {
    asio::co_spawn(browser->socket.get_executor(), write_to(browser), asio::detached);
    error_code e;
    for (;;) {
        beast::flat_buffer buffer(kMaxBrowserMessage_bytes);
        co_await browser->socket.async_read(buffer, to(e));
        if (e) break;
        if (browser->closing) continue;  // waits for its side of the closing
        const auto bytes = buffer.data();
        if (!browser->socket.got_binary())
            browser->close(websocket::close_code::unknown_data);
        else if (too_many(*browser))
            browser->close(websocket::close_code::policy_error);
        else
            hear(house, *browser, {static_cast<const char*>(bytes.data()), bytes.size()});
    }
    house.leave(browser);
    browser->close(websocket::close_code::none);  // the writer ends
}

asio::awaitable<void> upgrade(House& house, beast::tcp_stream& stream, const Parser& parser) {
    stream.expires_never();  // the WebSocket has its own times
    const auto browser = std::make_shared<Browser>(std::move(stream));
    auto& socket = browser->socket;
    websocket::stream_base::timeout times{house.options().request_timeout, house.options().silence, true};
    socket.set_option(times);
    socket.read_message_max(kMaxBrowserMessage_bytes);
    socket.binary(true);
    socket.auto_fragment(false);
    error_code e;
    co_await socket.async_accept(parser.get(), to(e));
    if (e) co_return;
    if (!house.admit(browser)) {
        const websocket::close_reason full(websocket::close_code::try_again_later);
        co_await socket.async_close(full, to(e));
        co_return;
    }
    co_await talk(house, browser);
}

}  // namespace

void Browser::close(websocket::close_code code) {
    if (!closing) why = code;
    closing = true;
    wake.cancel();
}

void Browser::put(const Topic& topic, const std::shared_ptr<const std::string>& body, std::uint64_t lost) {
    outbox.put(topic, body, lost, Clock::now());
    wake.cancel();
}

void Browser::answer(const v1::GatewayMessage& message) {
    if (!outbox.answer(message.SerializeAsString())) cut();
    wake.cancel();
}

void Browser::cut() {
    closing = true;
    error_code ignored;
    beast::get_lowest_layer(socket).socket().close(ignored);
    wake.cancel();
}

asio::awaitable<void> serve(House& house, asio::ip::tcp::socket socket) {
    error_code e;
    socket.set_option(asio::ip::tcp::no_delay(true), e);
    // What waits in the system is old when it comes: what is newest is chosen here, as late as can be.
    socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer_bytes), e);
    beast::tcp_stream stream(std::move(socket));
    beast::flat_buffer buffer(2 * kMaxHead_bytes);
    for (bool again = true; again;) {
        Parser parser;
        parser.header_limit(kMaxHead_bytes);
        parser.body_limit(0);
        stream.expires_after(house.options().request_timeout);
        co_await http::async_read(stream, buffer, parser, to(e));
        if (e == http::error::header_limit || e == http::error::buffer_overflow ||
            e == http::error::body_limit) {
            const HttpReply reply{431, {}, "the request is too large\n"};
            co_await send(stream, reply, false, e);
            break;
        }
        if (e) break;
        const HttpRequest request = plain_request(parser);
        std::optional<HttpReply> refused;
        if (request.upgrade) {
            refused = refuse_socket(request, house.options().rules);
            if (!refused) {
                co_await upgrade(house, stream, parser);
                co_return;
            }
        }
        const HttpReply reply =
            refused ? *std::move(refused) : answer(request, house.pages(), house.options().rules);
        stream.expires_after(house.options().stuck);
        again = co_await send(stream, reply, parser.get().keep_alive() && !request.upgrade, e);
    }
    stream.socket().shutdown(asio::ip::tcp::socket::shutdown_send, e);
}

}  // namespace kinevox::web
