#include "tests/bench/http2_watcher.h"

#include <nghttp2/nghttp2.h>

#include <algorithm>
#include <array>
#include <boost/asio/connect.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "common/host_port.h"

namespace kinevox::bench {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;

constexpr std::size_t kPrefix = 5;  // of a message: compressed or not, and its length

std::string framed(const std::string& message) {
    std::string out(kPrefix, '\0');
    for (std::size_t i = 0; i < 4; ++i) out[1 + i] = static_cast<char>(message.size() >> (8 * (3 - i)));
    return out + message;
}

std::size_t length_of(const char* prefix) {
    std::size_t length = 0;
    for (std::size_t i = 1; i < kPrefix; ++i) length = length << 8 | static_cast<unsigned char>(prefix[i]);
    return length;
}

nghttp2_nv header(std::string_view name, std::string_view value) {
    const auto bytes = [](std::string_view text) {
        return reinterpret_cast<std::uint8_t*>(const_cast<char*>(text.data()));
    };
    return {bytes(name), bytes(value), name.size(), value.size(), NGHTTP2_NV_FLAG_NONE};
}

struct SessionEnd {
    void operator()(nghttp2_session* session) const { nghttp2_session_del(session); }
};

}  // namespace

class Http2Stream::Connection : public std::enable_shared_from_this<Connection> {
  public:
    Connection(asio::io_context& io, Call call)
        : socket_(io), call_(std::move(call)), body_(framed(call_.request)) {}

    void begin() {
        const HostPort server = parse_host_port(call_.server).value_or(HostPort{});
        tcp::resolver resolver(socket_.get_executor());
        boost::system::error_code error;
        asio::connect(socket_, resolver.resolve(server.host, std::to_string(server.port), error), error);
        if (!error) socket_.set_option(tcp::no_delay(true), error);
        if (!error) socket_.non_blocking(true, error);
        if (error) return end(error.message());
        open_session();
        send();
        receive();
    }

    // Any thread.
    void cancel() {
        asio::post(socket_.get_executor(), [this, self = shared_from_this()] {
            if (ended_ || !session_) return;
            nghttp2_submit_rst_stream(session_.get(), NGHTTP2_FLAG_NONE, stream_, NGHTTP2_CANCEL);
            send();
            end("cancelled");
        });
    }

  private:
    static Connection& self(void* of) { return *static_cast<Connection*>(of); }

    void open_session() {
        nghttp2_session_callbacks* callbacks = nullptr;
        nghttp2_session_callbacks_new(&callbacks);
        nghttp2_session_callbacks_set_on_data_chunk_recv_callback(
            callbacks, [](nghttp2_session*, std::uint8_t, std::int32_t, const std::uint8_t* data,
                          std::size_t size, void* of) {
                self(of).take({reinterpret_cast<const char*>(data), size});
                return 0;
            });
        nghttp2_session_callbacks_set_on_header_callback(
            callbacks,
            [](nghttp2_session*, const nghttp2_frame*, const std::uint8_t* name, std::size_t name_size,
               const std::uint8_t* value, std::size_t value_size, std::uint8_t, void* of) {
                const std::string_view key(reinterpret_cast<const char*>(name), name_size);
                if (key == "grpc-message" || key == "grpc-status")
                    self(of).status_ += std::string(reinterpret_cast<const char*>(value), value_size) + " ";
                return 0;
            });
        nghttp2_session_callbacks_set_on_stream_close_callback(
            callbacks, [](nghttp2_session*, std::int32_t, std::uint32_t, void* of) {
                self(of).closed_ = true;
                return 0;
            });
        nghttp2_option* option = nullptr;
        nghttp2_option_new(&option);
        nghttp2_option_set_no_auto_window_update(option, call_.stalled);
        nghttp2_session* session = nullptr;
        nghttp2_session_client_new2(&session, callbacks, this, option);
        session_.reset(session);
        nghttp2_option_del(option);
        nghttp2_session_callbacks_del(callbacks);

        nghttp2_submit_settings(session, NGHTTP2_FLAG_NONE, nullptr, 0);
        const std::array headers = {header(":method", "POST"),   header(":scheme", "http"),
                                    header(":path", call_.path), header(":authority", call_.server),
                                    header("te", "trailers"),    header("content-type", "application/grpc")};
        const nghttp2_data_provider body = {
            {.ptr = this},
            [](nghttp2_session*, std::int32_t, std::uint8_t* out, std::size_t room, std::uint32_t* flags,
               nghttp2_data_source* source, void*) -> ssize_t {
                Connection& of = self(source->ptr);
                const std::size_t size = std::min(room, of.body_.size() - of.sent_);
                std::memcpy(out, of.body_.data() + of.sent_, size);
                of.sent_ += size;
                if (of.sent_ == of.body_.size()) *flags |= NGHTTP2_DATA_FLAG_EOF;
                return static_cast<ssize_t>(size);
            }};
        stream_ = nghttp2_submit_request(session, nullptr, headers.data(), headers.size(), &body, nullptr);
    }

    // What the session wants to say. Little: the request, windows and answers to pings.
    void send() {
        std::string out;
        const std::uint8_t* data = nullptr;
        while (const ssize_t size = nghttp2_session_mem_send(session_.get(), &data)) {
            if (size < 0) return end(nghttp2_strerror(static_cast<int>(size)));
            out.append(reinterpret_cast<const char*>(data), static_cast<std::size_t>(size));
        }
        if (out.empty()) return;
        boost::system::error_code error;
        asio::write(socket_, asio::buffer(out), error);
        if (error) end(error.message());
    }

    // Waits without a buffer: a thousand share the one of their thread.
    void receive() {
        if (!session_) return;
        socket_.async_wait(
            tcp::socket::wait_read, [this, self = shared_from_this()](boost::system::error_code error) {
                if (!session_) return;
                static thread_local std::vector<std::uint8_t> buffer(256 << 10);
                const std::size_t size = error ? 0 : socket_.read_some(asio::buffer(buffer), error);
                if (error == asio::error::would_block) return receive();
                if (error) return end(error.message());
                const ssize_t read = nghttp2_session_mem_recv(session_.get(), buffer.data(), size);
                if (read < 0) return end(nghttp2_strerror(static_cast<int>(read)));
                if (closed_) return end(status_);
                if (nghttp2_session_want_write(session_.get())) send();
                receive();
            });
    }

    // Messages as they come whole; one that lies in one piece is not copied.
    void take(std::string_view data) {
        if (!rest_.empty()) {
            rest_.append(data);
            data = rest_;
        }
        while (data.size() >= kPrefix && data.size() >= kPrefix + length_of(data.data())) {
            const std::size_t length = length_of(data.data());
            if (!(call_.stalled && taken_)) call_.on_message(data.substr(kPrefix, length));
            taken_ = true;
            data.remove_prefix(kPrefix + length);
        }
        rest_ = std::string(data);
    }

    void end(std::string why) {
        if (std::exchange(ended_, true)) return;
        boost::system::error_code ignored;
        socket_.close(ignored);
        asio::post(socket_.get_executor(),
                   [self = shared_from_this()] { self->session_.reset(); });  // it may be calling
        call_.on_end(std::move(why));
    }

    tcp::socket socket_;
    Call call_;
    const std::string body_;
    std::size_t sent_ = 0;  // of it
    std::unique_ptr<nghttp2_session, SessionEnd> session_;
    std::int32_t stream_ = 0;
    std::string rest_;  // the begin of a message
    std::string status_;
    bool taken_ = false, closed_ = false, ended_ = false;
};

Http2Stream::Http2Stream(asio::io_context& io, Call call)
    : connection_(std::make_shared<Connection>(io, std::move(call))) {
    asio::post(io, [connection = connection_] { connection->begin(); });
}

Http2Stream::~Http2Stream() = default;

void Http2Stream::stop() {
    connection_->cancel();
}

}  // namespace kinevox::bench
