// Handlers of RecordingService, without gRPC; on the recordings' thread, after check_recording().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/recording_service.pb.h"
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

}  // namespace kinevox
