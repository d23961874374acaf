// A subscriber that costs its machine as little as it can: gRPC's messages as HTTP/2 brings them (nghttp2),
// every one decoded.
//
// A thousand watchers are a thousand machines, of which a measurement has one, and the daemon's besides: what
// gRPC's own client spends on each message, the daemon then has not.
// https://github.com/grpc/grpc/blob/master/doc/PROTOCOL-HTTP2.md
#pragma once

#include <google/protobuf/arena.h>

#include <boost/asio/io_context.hpp>
#include <cstddef>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "tests/bench/watched.h"

namespace kinevox::bench {

// One server-streaming call on a connection of its own. Everything on the thread that runs `io`; stop() from
// any.
class Http2Stream {
  public:
    struct Call {
        std::string server;    // HOST:PORT
        std::string path;      // "/package.Service/Method"
        std::string request;   // the message's bytes
        bool stalled = false;  // takes one message, and opens the flow-control window never again
        std::function<void(std::string_view)> on_message;  // the bytes of one, until it returns
        std::function<void(std::string)> on_end;           // once; the status' words
    };
    Http2Stream(boost::asio::io_context& io, Call call);
    ~Http2Stream();
    void stop();

  private:
    class Connection;
    std::shared_ptr<Connection> connection_;
};

template <typename Message>
class Http2Watcher final : public Watcher {
  public:
    Http2Watcher(boost::asio::io_context& io, const std::string& server, std::string path,
                 std::string request, bool stalled)
        : stream_(io, {server, std::move(path), std::move(request), stalled,
                       [this](std::string_view bytes) { take(bytes); },
                       [this](std::string why) {
                           watched.why = std::move(why);
                           watched.ended = true;
                       }}) {}
    void stop() override { stream_.stop(); }

  private:
    void take(std::string_view bytes) {
        // One arena for all: they are read by one thread, one after the other.
        thread_local google::protobuf::Arena arena = [] {
            google::protobuf::ArenaOptions options;
            options.start_block_size = 64 << 10;
            return google::protobuf::Arena(options);
        }();
        arena.Reset();
        auto* message = google::protobuf::Arena::CreateMessage<Message>(&arena);
        if (message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size())))
            return watched.take(*message);
        watched.why = "a message that cannot be decoded";
        watched.ended = true;
        stop();
    }

    Http2Stream stream_;
};

}  // namespace kinevox::bench
