// CaptureService on gRPC's callback API hands each call to its handler on the right thread. Handlers, one
// function per method: check, act, translate. start_capture, stop_capture and learn_background block and run
// on the control thread; the others return at once, on any thread.
#pragma once

#include <absl/status/status.h>

#include <functional>

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

absl::Status get_status(const ApiContext& api, v1::GetStatusResponse& response);
absl::Status list_cameras(const ApiContext& api, const v1::ListCamerasRequest& request,
                          v1::ListCamerasResponse& response);
absl::Status list_subjects(const ApiContext& api, const v1::ListSubjectsRequest& request,
                           v1::ListSubjectsResponse& response);
absl::Status select_subjects(const ApiContext& api, const v1::SelectSubjectsRequest& request);
absl::Status name_subject(const ApiContext& api, const v1::NameSubjectRequest& request);
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

class CaptureServiceImpl final : public v1::CaptureService::CallbackService {
  public:
    explicit CaptureServiceImpl(const ApiContext& api) : api_(api) {}

    using Context = grpc::CallbackServerContext;
    using Reactor = grpc::ServerUnaryReactor;
    Reactor* GetStatus(Context*, const v1::GetStatusRequest*, v1::GetStatusResponse*) override;
    Reactor* ListCameras(Context*, const v1::ListCamerasRequest*, v1::ListCamerasResponse*) override;
    Reactor* StartCapture(Context*, const v1::StartCaptureRequest*, v1::StartCaptureResponse*) override;
    Reactor* StopCapture(Context*, const v1::StopCaptureRequest*, v1::StopCaptureResponse*) override;
    Reactor* LearnBackground(Context*, const v1::LearnBackgroundRequest*,
                             v1::LearnBackgroundResponse*) override;
    Reactor* ListSubjects(Context*, const v1::ListSubjectsRequest*, v1::ListSubjectsResponse*) override;
    Reactor* SelectSubjects(Context*, const v1::SelectSubjectsRequest*, v1::SelectSubjectsResponse*) override;
    Reactor* NameSubject(Context*, const v1::NameSubjectRequest*, v1::NameSubjectResponse*) override;
    Reactor* AcquireControl(Context*, const v1::AcquireControlRequest*, v1::AcquireControlResponse*) override;
    Reactor* RenewControl(Context*, const v1::RenewControlRequest*, v1::RenewControlResponse*) override;
    Reactor* ReleaseControl(Context*, const v1::ReleaseControlRequest*, v1::ReleaseControlResponse*) override;
    grpc::ServerWriteReactor<v1::WatchEventsResponse>* WatchEvents(Context*,
                                                                   const v1::WatchEventsRequest*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
