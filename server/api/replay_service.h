// ReplayService.
#pragma once

#include "kinevox/v1/replay_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

class ReplayServiceImpl final : public v1::ReplayService::CallbackService {
  public:
    explicit ReplayServiceImpl(const ApiContext& api) : api_(api) {}

    using Context = grpc::CallbackServerContext;
    using Reactor = grpc::ServerUnaryReactor;
    Reactor* OpenReplay(Context* context, const v1::OpenReplayRequest* request,
                        v1::OpenReplayResponse* response) override;
    Reactor* CloseReplay(Context* context, const v1::CloseReplayRequest* request,
                         v1::CloseReplayResponse* response) override;
    Reactor* UpdateReplay(Context* context, const v1::UpdateReplayRequest* request,
                          v1::UpdateReplayResponse* response) override;
    Reactor* GetReplay(Context* context, const v1::GetReplayRequest* request,
                       v1::GetReplayResponse* response) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
