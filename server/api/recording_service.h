// RecordingService on gRPC's callback API: hands each call to its handler on the recordings' thread.
#pragma once

#include "kinevox/v1/recording_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

class RecordingServiceImpl final : public v1::RecordingService::CallbackService {
  public:
    explicit RecordingServiceImpl(const ApiContext& api) : api_(api) {}

    using Context = grpc::CallbackServerContext;
    using Reactor = grpc::ServerUnaryReactor;
    Reactor* StartRecording(Context*, const v1::StartRecordingRequest*, v1::StartRecordingResponse*) override;
    Reactor* StopRecording(Context*, const v1::StopRecordingRequest*, v1::StopRecordingResponse*) override;
    Reactor* SaveBuffer(Context*, const v1::SaveBufferRequest*, v1::SaveBufferResponse*) override;
    Reactor* GetRecorderStatus(Context*, const v1::GetRecorderStatusRequest*,
                               v1::GetRecorderStatusResponse*) override;
    Reactor* ListRecordings(Context*, const v1::ListRecordingsRequest*, v1::ListRecordingsResponse*) override;
    Reactor* GetRecording(Context*, const v1::GetRecordingRequest*, v1::GetRecordingResponse*) override;
    grpc::ServerWriteReactor<v1::ExportRecordingResponse>* ExportRecording(
        Context*, const v1::ExportRecordingRequest*) override;
    Reactor* DeleteRecording(Context*, const v1::DeleteRecordingRequest*,
                             v1::DeleteRecordingResponse*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
