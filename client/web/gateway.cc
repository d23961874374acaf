#include "client/web/gateway.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/co_spawn.hpp>
#include <boost/asio/detached.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/redirect_error.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/use_awaitable.hpp>
#include <csignal>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "client/web/connection.h"
#include "client/web/daemon_streams.h"
#include "common/host_port.h"

namespace kinevox::web {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using websocket_code = boost::beast::websocket::close_code;

constexpr std::chrono::milliseconds kTick{500}, kMaxCloseTime{1'000};
constexpr int kHeartbeatTicks = 4;  // a page cannot see pings; without messages it reconnects

v1::GatewayMessage connection_message(const absl::Status& connection) {
    v1::GatewayMessage message;
    message.mutable_connection()->set_connected(connection.ok());
    message.mutable_connection()->set_message(std::string(connection.message()));
    return message;
}

v1::StreamKind stream_kind(Topic::Kind kind) {
    switch (kind) {
        case Topic::Kind::kPoses:
            return v1::STREAM_KIND_POSES;
        case Topic::Kind::kVolumes:
            return v1::STREAM_KIND_VOLUMES;
        case Topic::Kind::kSilhouette:
            return v1::STREAM_KIND_SILHOUETTE;
        case Topic::Kind::kStatus:
            break;
    }
    return v1::STREAM_KIND_STATUS;
}

absl::StatusOr<tcp::endpoint> endpoint_of(const std::string& listen) {
    const auto problem = absl::InvalidArgumentError(
        fmt::format("--listen '{}' is not HOST:PORT; for example 127.0.0.1:8090", listen));
    const auto address = parse_host_port(listen);
    if (!address) return problem;
    asio::io_context io;
    error_code e;
    const auto found =
        tcp::resolver(io).resolve(address->host, std::to_string(address->port), tcp::resolver::passive, e);
    if (e || found.empty()) return problem;
    return found.begin()->endpoint();
}

}  // namespace

struct Gateway::Parts final : GatewayContext {
    GatewayOptions gateway_options;
    Pages gateway_pages;
    std::map<asio::ip::address, std::size_t> half_open;  // connections without a request yet
    asio::io_context io{1};
    tcp::acceptor acceptor{io};
    asio::signal_set signals{io, SIGINT, SIGTERM};
    asio::steady_timer clock{io};
    std::set<std::shared_ptr<Browser>> browsers;
    std::size_t connections = 0;
    std::optional<absl::Status> connection;  // to the daemon; empty: not known yet
    bool ending = false;
    DaemonStreams daemon;
    StreamPool streams;  // last: its threads end first

    Parts(const GatewayOptions& options, Pages pages)
        : gateway_options(options),
          gateway_pages(std::move(pages)),
          daemon(options.daemon, options.show_names),
          streams(daemon, stream_options()) {}

    const GatewayOptions& options() const override { return gateway_options; }
    const Pages& pages() const override { return gateway_pages; }

    StreamPool::Options stream_options() {
        StreamPool::Options o;
        o.post = [this](std::function<void()> task) { asio::post(io, std::move(task)); };
        o.on_message = [this](const Topic& topic, const std::shared_ptr<const std::string>& body,
                              std::uint64_t dropped_count) {
            for (const auto& browser : browsers) browser->put(topic, body, dropped_count);
        };
        o.on_end = [this](const Topic& topic, const absl::Status& reason) { end_stream(topic, reason); };
        o.on_connection = [this](const absl::Status& now) { publish_connection(now); };
        return o;
    }

    bool admit(const std::shared_ptr<Browser>& browser) override {
        if (ending || browsers.size() >= gateway_options.max_clients) return false;
        browsers.insert(browser);
        if (browsers.size() == 1) connection.reset();  // without browsers the daemon was not polled
        if (connection) browser->reply(connection_message(*connection));
        subscriptions_changed();
        return true;
    }

    void remove(const std::shared_ptr<Browser>& browser) override {
        browsers.erase(browser);
        subscriptions_changed();
        if (ending && browsers.empty()) io.stop();
    }

    // Without browsers no stream runs. With any, the status always does: it shows whether the daemon answers.
    void subscriptions_changed() override {
        std::set<Topic> topics;
        if (!browsers.empty() && !ending) topics.insert({Topic::Kind::kStatus, 0, {}});
        for (const auto& browser : browsers)
            for (const Topic& topic : browser->outbox.topics()) topics.insert(topic);
        streams.set_topics(ending ? std::set<Topic>() : topics);
    }

    void publish_connection(const absl::Status& now) {
        connection = now;
        if (now.ok())
            fmt::print(stderr, "kinevox-web: connected to {}\n", gateway_options.daemon.server);
        else
            fmt::print(stderr, "kinevox-web: {}; retrying\n", std::string(now.message()));
        for (const auto& browser : browsers) browser->reply(connection_message(now));
    }

    // The daemon rejected the stream; a retry would be rejected, too.
    void end_stream(const Topic& topic, const absl::Status& reason) {
        v1::GatewayMessage message;
        v1::StreamError& error = *message.mutable_error();
        v1::StreamSubscription& subscription = *error.mutable_subscription();
        subscription.set_kind(stream_kind(topic.kind));
        subscription.set_downsample_level(topic.downsample_level);
        subscription.set_camera(topic.camera);
        error.set_code(absl::StatusCodeToString(reason.code()));
        error.set_message(std::string(reason.message()));
        for (const auto& browser : browsers) {
            const auto topics = browser->outbox.topics();
            if (std::find(topics.begin(), topics.end(), topic) == topics.end()) continue;
            browser->outbox.unsubscribe(topic);
            browser->reply(message);
        }
        subscriptions_changed();
    }

    // Counts a new connection of `address` until it is released; null: too many.
    std::shared_ptr<void> add_half_open(const asio::ip::address& address) {
        std::size_t& count = half_open[address];
        if (count >= gateway_options.max_half_open_per_address) return nullptr;
        ++count;
        return {this, [address](Parts* parts) {
                    if (--parts->half_open[address] == 0) parts->half_open.erase(address);
                }};
    }

    asio::awaitable<void> accept() {
        for (;;) {
            error_code e;
            tcp::socket socket(io);
            co_await acceptor.async_accept(socket, asio::redirect_error(asio::use_awaitable, e));
            if (ending) co_return;
            if (e) {  // out of file handles, for instance
                asio::steady_timer pause(io, std::chrono::milliseconds(100));
                co_await pause.async_wait(asio::redirect_error(asio::use_awaitable, e));
                continue;
            }
            if (connections >= gateway_options.max_connections) continue;  // closes the socket
            const auto remote = socket.remote_endpoint(e);
            if (e) continue;
            std::shared_ptr<void> slot = add_half_open(remote.address());
            if (!slot) continue;
            ++connections;
            asio::co_spawn(io, serve(*this, std::move(socket), std::move(slot)),
                           [this](const std::exception_ptr&) { --connections; });
        }
    }

    asio::awaitable<void> watch_browsers() {
        for (int tick = 1; !ending; ++tick) {
            error_code e;
            clock.expires_after(kTick);
            co_await clock.async_wait(asio::redirect_error(asio::use_awaitable, e));
            const auto now = Clock::now();
            for (const auto& browser : browsers) {
                const bool writing = browser->writing_since != Clock::time_point{};
                if (writing && now - browser->writing_since > gateway_options.write_timeout)
                    browser->disconnect();
                if (!writing && connection && tick % kHeartbeatTicks == 0)
                    browser->reply(connection_message(*connection));
            }
        }
    }

    void end() {
        if (ending) return;
        ending = true;
        error_code ignored;
        acceptor.close(ignored);
        signals.cancel(ignored);
        for (const auto& browser : browsers) browser->close(websocket_code::going_away);
        subscriptions_changed();
        clock.expires_after(kMaxCloseTime);
        clock.async_wait([this](const error_code&) { io.stop(); });
        if (browsers.empty()) io.stop();
    }
};

Gateway::Gateway(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Gateway::~Gateway() = default;

absl::StatusOr<std::unique_ptr<Gateway>> Gateway::open(const GatewayOptions& options, Pages pages) {
    const auto endpoint = endpoint_of(options.listen);
    if (!endpoint.ok()) return endpoint.status();
    auto parts = std::make_unique<Parts>(options, std::move(pages));
    error_code e;
    tcp::acceptor& acceptor = parts->acceptor;
    acceptor.open(endpoint->protocol(), e);
    if (!e) acceptor.set_option(tcp::acceptor::reuse_address(true), e);
    if (!e) acceptor.bind(*endpoint, e);
    if (!e) acceptor.listen(asio::socket_base::max_listen_connections, e);
    if (e)
        return absl::UnavailableError(fmt::format(
            "cannot listen on {}: {}; choose another address with --listen", options.listen, e.message()));
    return std::unique_ptr<Gateway>(new Gateway(std::move(parts)));
}

std::string Gateway::address() const {
    const tcp::endpoint at = parts_->acceptor.local_endpoint();
    const std::string host = at.address().to_string();
    return at.address().is_v6() ? fmt::format("[{}]:{}", host, at.port())
                                : fmt::format("{}:{}", host, at.port());
}

void Gateway::run() {
    Parts& parts = *parts_;
    parts.signals.async_wait([&parts](const error_code& e, int) {
        if (!e) parts.end();
    });
    asio::co_spawn(parts.io, parts.accept(), asio::detached);
    asio::co_spawn(parts.io, parts.watch_browsers(), asio::detached);
    parts.io.run();
}

void Gateway::stop() {
    asio::post(parts_->io, [this] { parts_->end(); });
}

}  // namespace kinevox::web
