#include "server/metrics/http_endpoint.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <optional>
#include <string_view>
#include <thread>
#include <utility>

#include "common/host_port.h"

namespace kinevox::metrics {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;

constexpr std::chrono::seconds kTimeout{10};  // for one request or answer
constexpr std::uint32_t kMaxHead = 8 << 10;
constexpr int kMaxConnections = 32;

// One connection; lives until its last operation ends.
class Connection : public std::enable_shared_from_this<Connection> {
  public:
    Connection(tcp::socket socket, const HttpEndpoint::Metrics& metrics, std::shared_ptr<void> counted)
        : stream_(std::move(socket)), metrics_(metrics), counted_(std::move(counted)) {}

    void read() {
        parser_.emplace();
        parser_->header_limit(kMaxHead);
        parser_->body_limit(0);
        stream_.expires_after(kTimeout);
        http::async_read(stream_, buffer_, *parser_,
                         [self = shared_from_this()](beast::error_code error, std::size_t) {
                             if (!error)
                                 self->answer();
                             else
                                 self->close();
                         });
    }

  private:
    void answer() {
        const http::request<http::empty_body>& request = parser_->get();
        const std::string_view target(request.target().data(), request.target().size());
        response_ = {};
        response_.version(request.version());
        response_.keep_alive(request.keep_alive());
        if (target.substr(0, target.find('?')) != "/metrics") {
            say(http::status::not_found, "there is /metrics and nothing else\n");
        } else if (request.method() != http::verb::get && request.method() != http::verb::head) {
            response_.set(http::field::allow, "GET, HEAD");
            say(http::status::method_not_allowed, "/metrics is read by GET\n");
        } else {
            const auto accept = request[http::field::accept];
            const bool open = accept.find("application/openmetrics-text") != beast::string_view::npos;
            const Format format = open ? Format::kOpenMetrics : Format::kPrometheus;
            say(http::status::ok, metrics_(format));
            const std::string_view type = content_type(format);
            response_.set(http::field::content_type, beast::string_view(type.data(), type.size()));
        }
        response_.prepare_payload();
        if (request.method() == http::verb::head) response_.body().clear();
        stream_.expires_after(kTimeout);
        http::async_write(stream_, response_,
                          [self = shared_from_this()](beast::error_code error, std::size_t) {
                              if (!error && self->response_.keep_alive())
                                  self->read();
                              else
                                  self->close();
                          });
    }

    void say(http::status status, std::string text) {
        response_.result(status);
        response_.set(http::field::content_type, "text/plain; charset=utf-8");
        response_.body() = std::move(text);
    }

    void close() {
        beast::error_code ignored;
        stream_.socket().shutdown(tcp::socket::shutdown_both, ignored);
    }

    beast::tcp_stream stream_;
    const HttpEndpoint::Metrics& metrics_;
    std::shared_ptr<void> counted_;  // counts the open connections
    beast::flat_buffer buffer_;
    std::optional<http::request_parser<http::empty_body>> parser_;
    http::response<http::string_body> response_;
};

absl::Status cannot_listen(const std::string& address, const beast::error_code& error) {
    return absl::UnavailableError(
        fmt::format("cannot serve metrics on {}: {}; stop the other program, or set another listen "
                    "under [metrics]",
                    address, error.message()));
}

}  // namespace

struct HttpEndpoint::Parts {
    asio::io_context io{1};
    tcp::acceptor acceptor{io};
    Metrics metrics;
    std::shared_ptr<void> connections = std::make_shared<int>();
    std::thread thread;

    void accept() {
        acceptor.async_accept([this](const beast::error_code& error, tcp::socket socket) {
            if (error == asio::error::operation_aborted) return;
            if (error) {  // for example no file descriptor left: retry later
                spdlog::warn("metrics: {}", error.message());
                std::this_thread::sleep_for(std::chrono::milliseconds(100));
            } else if (connections.use_count() <= kMaxConnections) {  // else it is closed
                std::make_shared<Connection>(std::move(socket), metrics, connections)->read();
            }
            accept();
        });
    }
};

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::listen(const std::string& address,
                                                                   Metrics metrics) {
    auto parts = std::make_unique<Parts>();
    parts->metrics = std::move(metrics);
    beast::error_code error = asio::error::invalid_argument;
    const auto host_port = parse_host_port(address);
    if (!host_port) return cannot_listen(address, error);
    const auto found = tcp::resolver(parts->io).resolve(host_port->host, std::to_string(host_port->port),
                                                        tcp::resolver::passive, error);
    if (error || found.empty()) return cannot_listen(address, error);
    const tcp::endpoint endpoint = found.begin()->endpoint();
    parts->acceptor.open(endpoint.protocol(), error);
    if (!error) parts->acceptor.set_option(tcp::acceptor::reuse_address(true), error);
    if (!error) parts->acceptor.bind(endpoint, error);
    if (!error) parts->acceptor.listen(tcp::acceptor::max_listen_connections, error);
    if (error) return cannot_listen(address, error);
    parts->accept();
    Parts* const running = parts.get();
    parts->thread = std::thread([running] { running->io.run(); });
    return std::unique_ptr<HttpEndpoint>(new HttpEndpoint(std::move(parts)));
}

HttpEndpoint::HttpEndpoint(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}

HttpEndpoint::~HttpEndpoint() {
    parts_->io.stop();
    parts_->thread.join();
}

int HttpEndpoint::port() const {
    return parts_->acceptor.local_endpoint().port();
}

}  // namespace kinevox::metrics
