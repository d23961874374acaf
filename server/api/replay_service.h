// ReplayService on gRPC's callback API hands each call to its handler on the right thread. Handlers are
// without gRPC.
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/replay_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition if this daemon has no replay.
absl::Status check_replay(const ApiContext& api);

// On the control thread, after check_replay().
absl::Status open_replay(const ApiContext& api, const v1::OpenReplayRequest& request,
                         v1::OpenReplayResponse& response);
absl::Status close_replay(const ApiContext& api, const v1::CloseReplayRequest& request,
                          v1::CloseReplayResponse& response);

// On any thread.
absl::Status update_replay(const ApiContext& api, const v1::UpdateReplayRequest& request,
                           v1::UpdateReplayResponse& response);
absl::Status get_replay(const ApiContext& api, const v1::GetReplayRequest& request,
                        v1::GetReplayResponse& response);

// FailedPrecondition while a recording is replayed; `what` requires the cameras: "recording requires".
absl::Status check_live(const ApiContext& api, const char* what);

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
