// CaptureService's calls, one function each: check, act, translate. Those that take time run on the control
// thread (start_capture, stop_capture, learn_background); the others answer at once, on any thread.
#pragma once

#include <absl/status/status.h>

#include <functional>

#include "kinevox/v1/capture_service.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

absl::Status get_status(const ApiContext& api, v1::GetStatusResponse& response);
absl::Status list_cameras(const ApiContext& api, v1::ListCamerasResponse& response);
absl::Status acquire_control(const ApiContext& api, const v1::AcquireControlRequest& request,
                             v1::AcquireControlResponse& response);
absl::Status renew_control(const ApiContext& api, const v1::RenewControlRequest& request,
                           v1::RenewControlResponse& response);
absl::Status release_control(const ApiContext& api, const v1::ReleaseControlRequest& request);

absl::Status start_capture(const ApiContext& api, const v1::StartRequest& request);
absl::Status stop_capture(const ApiContext& api, const v1::StopRequest& request);
void learn_background(const ApiContext& api, const v1::LearnBackgroundRequest& request,
                      std::function<void(absl::Status)> done);

absl::Status check_watch_events(const v1::WatchEventsRequest& request);

}  // namespace kinevox
