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
#include <optional>
#include <set>
#include <utility>

#include "client/web/connection.h"
#include "client/web/daemon_streams.h"
#include "client/web/feeds.h"

namespace kinevox::web {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using websocket_code = boost::beast::websocket::close_code;

constexpr std::chrono::milliseconds kTick{500}, kFarewell{1'000};
constexpr int kSignOfLife = 4;  // ticks: a page cannot see pings, and takes silence for a lost connection

v1::GatewayMessage link_message(const absl::Status& link) {
    v1::GatewayMessage message;
    message.mutable_link()->set_connected(link.ok());
    message.mutable_link()->set_message(std::string(link.message()));
    return message;
}

absl::StatusOr<tcp::endpoint> endpoint_of(const std::string& listen) {
    const auto problem = absl::InvalidArgumentError(
        fmt::format("'{}' is no HOST:PORT to listen on; give one like 127.0.0.1:8090", listen));
    const std::size_t colon = listen.rfind(':');
    if (colon == std::string::npos || colon == 0) return problem;
    std::string host = listen.substr(0, colon);
    const std::string port = listen.substr(colon + 1);
    if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
    if (port.empty() || port.size() > 5 || port.find_first_not_of("0123456789") != std::string::npos ||
        std::stoi(port) > 65535)
        return problem;
    asio::io_context io;
    error_code e;
    const auto found = tcp::resolver(io).resolve(host, port, tcp::resolver::passive, e);
    if (e || found.empty()) return problem;
    return found.begin()->endpoint();
}

}  // namespace

struct Gateway::Parts final : House {
    GatewayOptions gateway_options;
    Pages gateway_pages;
    asio::io_context io{1};
    tcp::acceptor acceptor{io};
    asio::signal_set signals{io, SIGINT, SIGTERM};
    asio::steady_timer clock{io};
    std::set<std::shared_ptr<Browser>> browsers;
    std::size_t connections = 0;
    std::optional<absl::Status> link;  // none: the daemon was not asked yet
    bool ending = false;
    DaemonStreams daemon;
    Feeds feeds;  // last: its threads end first

    Parts(const GatewayOptions& options, Pages pages)
        : gateway_options(options),
          gateway_pages(std::move(pages)),
          daemon(options.daemon),
          feeds(daemon, feed_options()) {}

    const GatewayOptions& options() const override { return gateway_options; }
    const Pages& pages() const override { return gateway_pages; }

    Feeds::Options feed_options() {
        Feeds::Options o;
        o.post = [this](std::function<void()> task) { asio::post(io, std::move(task)); };
        o.on_message = [this](const Topic& topic, const std::shared_ptr<const std::string>& body,
                              std::uint64_t lost) {
            for (const auto& browser : browsers) browser->put(topic, body, lost);
        };
        o.on_end = [this](const Topic& topic, const absl::Status& why) { refuse(topic, why); };
        o.on_link = [this](const absl::Status& now) { tell_link(now); };
        return o;
    }

    bool admit(const std::shared_ptr<Browser>& browser) override {
        if (ending || browsers.size() >= gateway_options.max_browsers) return false;
        browsers.insert(browser);
        if (browsers.size() == 1) link.reset();  // nobody asked meanwhile
        if (link) browser->answer(link_message(*link));
        wants_changed();
        return true;
    }

    void leave(const std::shared_ptr<Browser>& browser) override {
        browsers.erase(browser);
        wants_changed();
        if (ending && browsers.empty()) io.stop();
    }

    // Nobody there: nothing is asked of the daemon. The status tells how the daemon is, whoever wants it.
    void wants_changed() override {
        std::set<Topic> topics;
        if (!browsers.empty() && !ending) topics.insert({Topic::Kind::kStatus, 0, {}});
        for (const auto& browser : browsers)
            for (const Topic& topic : browser->outbox.topics()) topics.insert(topic);
        feeds.want(ending ? std::set<Topic>() : topics);
    }

    void tell_link(const absl::Status& now) {
        link = now;
        if (now.ok())
            fmt::print(stderr, "kinevox-web: the daemon at {} answers\n", gateway_options.daemon.server);
        else
            fmt::print(stderr, "kinevox-web: {}; trying again\n", std::string(now.message()));
        for (const auto& browser : browsers) browser->answer(link_message(now));
    }

    // The daemon said no, and would say so again.
    void refuse(const Topic& topic, const absl::Status& why) {
        v1::GatewayMessage message;
        v1::Refusal& refusal = *message.mutable_refusal();
        v1::Want& want = *refusal.mutable_want();
        want.set_kind(topic.kind == Topic::Kind::kPoses        ? v1::KIND_POSES
                      : topic.kind == Topic::Kind::kVolumes    ? v1::KIND_VOLUMES
                      : topic.kind == Topic::Kind::kSilhouette ? v1::KIND_SILHOUETTE
                                                               : v1::KIND_STATUS);
        want.set_level(topic.level);
        want.set_camera(topic.camera);
        refusal.set_code(absl::StatusCodeToString(why.code()));
        refusal.set_message(std::string(why.message()));
        for (const auto& browser : browsers) {
            const auto topics = browser->outbox.topics();
            if (std::find(topics.begin(), topics.end(), topic) == topics.end()) continue;
            browser->outbox.unsubscribe(topic);
            browser->answer(message);
        }
        wants_changed();
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
            if (connections >= gateway_options.max_connections) continue;  // closes it
            ++connections;
            asio::co_spawn(io, serve(*this, std::move(socket)),
                           [this](const std::exception_ptr&) { --connections; });
        }
    }

    asio::awaitable<void> look_after() {
        for (int tick = 1; !ending; ++tick) {
            error_code e;
            clock.expires_after(kTick);
            co_await clock.async_wait(asio::redirect_error(asio::use_awaitable, e));
            const auto now = Clock::now();
            for (const auto& browser : browsers) {
                const bool writing = browser->writing_since != Clock::time_point{};
                if (writing && now - browser->writing_since > gateway_options.stuck) browser->cut();
                if (!writing && link && tick % kSignOfLife == 0) browser->answer(link_message(*link));
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
        wants_changed();
        clock.expires_after(kFarewell);
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
        return absl::UnavailableError(fmt::format("cannot listen on {}: {}; choose another with --listen",
                                                  options.listen, e.message()));
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
    asio::co_spawn(parts.io, parts.look_after(), asio::detached);
    parts.io.run();
}

void Gateway::stop() {
    asio::post(parts_->io, [this] { parts_->end(); });
}

}  // namespace kinevox::web
