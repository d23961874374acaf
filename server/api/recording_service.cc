#include "server/api/recording_service.h"

#include "server/api/export_reactor.h"
#include "server/api/recording_handlers.h"
#include "server/api/to_proto.h"
#include "server/api/unary_call.h"

namespace kinevox {

RecordingServiceImpl::Reactor* RecordingServiceImpl::StartRecording(Context* context,
                                                                    const v1::StartRecordingRequest* request,
                                                                    v1::StartRecordingResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, start_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::StopRecording(Context* context,
                                                                   const v1::StopRecordingRequest* request,
                                                                   v1::StopRecordingResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, stop_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::SaveBuffer(Context* context,
                                                                const v1::SaveBufferRequest* request,
                                                                v1::SaveBufferResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, save_buffer);
}

// Must not queue behind calls that block on files.
RecordingServiceImpl::Reactor* RecordingServiceImpl::GetRecorderStatus(
    Context* context, const v1::GetRecorderStatusRequest* request, v1::GetRecorderStatusResponse* response) {
    return answer(context, get_recorder_status(api_, *request, *response));
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::ListRecordings(Context* context,
                                                                    const v1::ListRecordingsRequest* request,
                                                                    v1::ListRecordingsResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, list_recordings);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::GetRecording(Context* context,
                                                                  const v1::GetRecordingRequest* request,
                                                                  v1::GetRecordingResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, get_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::DeleteRecording(
    Context* context, const v1::DeleteRecordingRequest* request, v1::DeleteRecordingResponse* response) {
    return unary_call(api_, api_.recordings, context, request, response, check_recording, delete_recording);
}

grpc::ServerWriteReactor<v1::ExportRecordingResponse>* RecordingServiceImpl::ExportRecording(
    Context* context, const v1::ExportRecordingRequest* request) {
    return ExportReactor::run(api_, context, *request);
}

}  // namespace kinevox
