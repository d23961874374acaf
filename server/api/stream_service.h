// StreamService: subscriptions checked, results translated.
#pragma once

#include <absl/status/statusor.h>

#include "kinevox/v1/stream_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// Many subscribers share the bytes of a message; gRPC would serialise it for each.
using RawStreamService = v1::StreamService::WithRawCallbackMethod_StreamVolumes<
    v1::StreamService::WithRawCallbackMethod_StreamPoses<
        v1::StreamService::WithRawCallbackMethod_StreamPreviews<v1::StreamService::Service>>>;

class StreamServiceImpl final : public RawStreamService {
  public:
    explicit StreamServiceImpl(const ApiContext& api) : api_(api) {}

    grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamVolumes(grpc::CallbackServerContext* context,
                                                              const grpc::ByteBuffer* request) override;
    grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamPoses(grpc::CallbackServerContext* context,
                                                            const grpc::ByteBuffer* request) override;
    grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamPreviews(grpc::CallbackServerContext* context,
                                                               const grpc::ByteBuffer* request) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
