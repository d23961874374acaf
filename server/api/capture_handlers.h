// Handlers of CaptureService, one function per method: check, act, translate. start_capture, stop_capture and
// learn_background block and run on the control thread; the others return at once, on any thread.
#pragma once

#include <absl/status/status.h>

#include <functional>

#include "kinevox/v1/capture_service.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

absl::Status get_status(const ApiContext& api, v1::GetStatusResponse& response);
absl::Status list_cameras(const ApiContext& api, const v1::ListCamerasRequest& request,
                          v1::ListCamerasResponse& response);
absl::Status acquire_control(const ApiContext& api, const v1::AcquireControlRequest& request,
                             v1::AcquireControlResponse& response);
absl::Status renew_control(const ApiContext& api, const v1::RenewControlRequest& request,
                           v1::RenewControlResponse& response);
absl::Status release_control(const ApiContext& api, const v1::ReleaseControlRequest& request,
                             v1::ReleaseControlResponse& response);

absl::Status start_capture(const ApiContext& api, const v1::StartCaptureRequest& request,
                           v1::StartCaptureResponse& response);
absl::Status stop_capture(const ApiContext& api, const v1::StopCaptureRequest& request,
                          v1::StopCaptureResponse& response);
void learn_background(const ApiContext& api, const v1::LearnBackgroundRequest& request,
                      std::function<void(absl::Status)> done);

absl::Status check_watch_events(const v1::WatchEventsRequest& request);

}  // namespace kinevox
