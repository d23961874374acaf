// What ReplayService's calls do, without gRPC.
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/replay_service.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition where this daemon has no replay.
absl::Status check_replay(const ApiContext& api);

// The control thread's, after check_replay().
absl::Status open_replay(const ApiContext& api, const v1::OpenReplayRequest& request,
                         v1::OpenReplayResponse& response);
absl::Status close_replay(const ApiContext& api, const v1::CloseReplayRequest& request,
                          v1::CloseReplayResponse& response);

// Any.
absl::Status set_replay(const ApiContext& api, const v1::SetReplayRequest& request,
                        v1::SetReplayResponse& response);
absl::Status get_replay(const ApiContext& api, const v1::GetReplayRequest& request,
                        v1::GetReplayResponse& response);

// FailedPrecondition while a recording is replayed; `why` the cameras are needed: "a calibration is of".
absl::Status check_live(const ApiContext& api, const char* why);

}  // namespace kinevox
