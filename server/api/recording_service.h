// RecordingService on gRPC's callback API hands each call to its handler, on the recordings' thread, after
// check_recording(). Handlers are without gRPC.
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/recording_service.grpc.pb.h"
#include "server/api/api_context.h"
#include "server/recording/recorder.h"

namespace kinevox {

// FailedPrecondition if this daemon has no folder for recordings.
absl::Status check_recording(const ApiContext& api);

v1::Recording to_proto(const RecordingInfo& info);

absl::Status start_recording(const ApiContext& api, const v1::StartRecordingRequest& request,
                             v1::StartRecordingResponse& response);
absl::Status stop_recording(const ApiContext& api, const v1::StopRecordingRequest& request,
                            v1::StopRecordingResponse& response);
absl::Status save_buffer(const ApiContext& api, const v1::SaveBufferRequest& request,
                         v1::SaveBufferResponse& response);
absl::Status get_recorder_status(const ApiContext& api, const v1::GetRecorderStatusRequest& request,
                                 v1::GetRecorderStatusResponse& response);
absl::Status list_recordings(const ApiContext& api, const v1::ListRecordingsRequest& request,
                             v1::ListRecordingsResponse& response);
absl::Status get_recording(const ApiContext& api, const v1::GetRecordingRequest& request,
                           v1::GetRecordingResponse& response);
absl::Status delete_recording(const ApiContext& api, const v1::DeleteRecordingRequest& request,
                              v1::DeleteRecordingResponse& response);

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
