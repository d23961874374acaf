// CaptureService on gRPC's callback API: hands each call to its handler on the right thread.
#pragma once

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

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
    Reactor* AcquireControl(Context*, const v1::AcquireControlRequest*, v1::AcquireControlResponse*) override;
    Reactor* RenewControl(Context*, const v1::RenewControlRequest*, v1::RenewControlResponse*) override;
    Reactor* ReleaseControl(Context*, const v1::ReleaseControlRequest*, v1::ReleaseControlResponse*) override;
    grpc::ServerWriteReactor<v1::WatchEventsResponse>* WatchEvents(Context*,
                                                                   const v1::WatchEventsRequest*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
