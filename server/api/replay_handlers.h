// Handlers of ReplayService, without gRPC.
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/replay_service.pb.h"
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

}  // namespace kinevox
