// A subscriber as gRPC's own library makes it.
#pragma once

#include <google/protobuf/arena.h>
#include <grpcpp/grpcpp.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "kinevox/v1/stream_service.grpc.pb.h"
#include "tests/bench/watched.h"

namespace kinevox::bench {

// `stalled`: subscribes, reads one message and never again.
template <typename Request, typename Message>
class GrpcWatcher final : public Watcher, public grpc::ClientReadReactor<Message> {
  public:
    template <typename Begin>
    GrpcWatcher(const std::string& server, const Request& request, bool stalled, const Begin& begin)
        : request_(request), stalled_(stalled) {
        grpc::ChannelArguments arguments;
        arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);  // a connection of its own
        // They share the daemon's cores: work that a thousand machines would do is omitted.
        arguments.SetInt(GRPC_ARG_MINIMAL_STACK, 1);
        arguments.SetInt(GRPC_ARG_ENABLE_CHANNELZ, 0);
        arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
        arguments.SetMaxReceiveMessageSize(256 << 20);
        stub_ = v1::StreamService::NewStub(
            grpc::CreateCustomChannel(server, grpc::InsecureChannelCredentials(), arguments));
        begin(*stub_, &context_, &request_, this);
        read();
        this->StartCall();
    }

    void OnReadDone(bool ok) override {
        if (!ok) return;
        watched.take(*message_);
        if (!stalled_) read();
    }
    void OnDone(const grpc::Status& status) override {
        watched.why = status.error_message();
        watched.ended = true;
    }
    void stop() override { context_.TryCancel(); }

  private:
    static constexpr std::size_t kBlock = 32 << 10;

    // A pose has some 150 parts: on an arena they cost one allocation.
    void read() {
        arena_.Reset();
        message_ = google::protobuf::Arena::CreateMessage<Message>(&arena_);
        this->StartRead(message_);
    }

    Request request_;
    const bool stalled_;
    grpc::ClientContext context_;
    std::unique_ptr<v1::StreamService::Stub> stub_;
    std::vector<char> block_ = std::vector<char>(kBlock);
    google::protobuf::Arena arena_{block_.data(), block_.size()};
    Message* message_ = nullptr;
};

}  // namespace kinevox::bench
