#include "server/api/recording_service.h"

#include <fmt/format.h>

#include "common/proto_time.h"
#include "server/api/call.h"
#include "server/api/export_reactor.h"
#include "server/api/replay_service.h"
#include "server/api/request_arguments.h"
#include "server/api/to_proto.h"

namespace kinevox {
namespace {

v1::RecordingCodec codec_to_proto(std::string_view name) {
    if (name == name_of(VideoCodec::kFfv1)) return v1::RECORDING_CODEC_FFV1;
    if (name == name_of(VideoCodec::kUtVideo)) return v1::RECORDING_CODEC_UTVIDEO;
    if (name == name_of(VideoCodec::kH264)) return v1::RECORDING_CODEC_H264;
    return v1::RECORDING_CODEC_UNSPECIFIED;
}

absl::StatusOr<std::optional<VideoCodec>> codec_from_proto(v1::RecordingCodec codec) {
    switch (codec) {
        case v1::RECORDING_CODEC_UNSPECIFIED:
            return std::nullopt;
        case v1::RECORDING_CODEC_FFV1:
            return VideoCodec::kFfv1;
        case v1::RECORDING_CODEC_UTVIDEO:
            return VideoCodec::kUtVideo;
        case v1::RECORDING_CODEC_H264:
            return VideoCodec::kH264;
        default:
            return absl::InvalidArgumentError(
                fmt::format("codec {} is unknown; use FFV1, UTVIDEO or H264", static_cast<int>(codec)));
    }
}

v1::RecorderState to_proto(RecorderState state) {
    switch (state) {
        case RecorderState::kIdle:
            return v1::RECORDER_STATE_IDLE;
        case RecorderState::kWaiting:
            return v1::RECORDER_STATE_WAITING;
        case RecorderState::kRecording:
            return v1::RECORDER_STATE_RECORDING;
        case RecorderState::kFinishing:
            return v1::RECORDER_STATE_FINISHING;
    }
    return v1::RECORDER_STATE_UNSPECIFIED;
}

}  // namespace

v1::Recording to_proto(const RecordingInfo& info) {
    v1::Recording out;
    out.set_name(info.name);
    *out.mutable_start_time() = to_timestamp(info.about.start_time_utc_ns);
    *out.mutable_duration() = duration_from_s(info.duration_s);
    out.set_nominal_fps(info.fps);
    out.set_frame_set_count(info.about.frame_sets);
    out.set_size_bytes(info.size_bytes);
    out.set_dropped_frame_set_count(info.about.dropped_frame_sets);
    out.set_lost_frame_set_count(info.about.lost_frame_sets);
    out.set_missing_image_count(info.about.missing_images);
    out.set_codec(codec_to_proto(info.about.codec));
    for (const std::string& camera : info.cameras) out.add_cameras(camera);
    out.set_closed(info.about.closed);
    out.set_recovered(info.about.recovered);
    out.set_end_reason(info.about.end_reason);
    out.set_has_background(info.has_background);
    out.set_has_poses(!info.about.poses.empty());
    out.set_has_volumes(!info.about.volumes.empty());
    out.set_calibration_id(info.about.calibration_id);
    return out;
}

absl::Status check_recording(const ApiContext& api) {
    if (api.recorder && !api.recorder->options().folder.empty()) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon has no folder for recordings; set [recording] folder in its configuration");
}

absl::Status start_recording(const ApiContext& api, const v1::StartRecordingRequest& request,
                             v1::StartRecordingResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status live = check_live(api, "recording requires"); !live.ok()) return live;
    const auto codec = codec_from_proto(request.codec());
    if (!codec.ok()) return codec.status();
    auto name = api.recorder->start(request.name(), *codec);
    if (!name.ok()) return name.status();
    response.set_name(*name);
    return absl::OkStatus();
}

absl::Status stop_recording(const ApiContext& api, const v1::StopRecordingRequest& request,
                            v1::StopRecordingResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    const auto info = api.recorder->stop();
    if (!info.ok()) return info.status();
    *response.mutable_recording() = to_proto(*info);
    return absl::OkStatus();
}

absl::Status save_buffer(const ApiContext& api, const v1::SaveBufferRequest& request,
                         v1::SaveBufferResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status live = check_live(api, "recording requires"); !live.ok()) return live;
    const auto info = api.recorder->save_buffer(request.name(), to_seconds(request.duration()),
                                                request.continue_recording());
    if (!info.ok()) return info.status();
    *response.mutable_recording() = to_proto(*info);
    return absl::OkStatus();
}

absl::Status get_recorder_status(const ApiContext& api, const v1::GetRecorderStatusRequest&,
                                 v1::GetRecorderStatusResponse& response) {
    if (!check_recording(api).ok()) {
        response.set_state(v1::RECORDER_STATE_DISABLED);
        return absl::OkStatus();
    }
    const RecorderOptions& options = api.recorder->options();
    const RecorderStatus status = api.recorder->status();
    response.set_state(to_proto(status.state));
    if (status.current) *response.mutable_current() = to_proto(*status.current);
    if (status.latest) *response.mutable_latest() = to_proto(*status.latest);
    response.set_folder(options.folder.string());
    response.set_free_bytes(static_cast<std::int64_t>(status.free_bytes));
    response.set_min_free_bytes(static_cast<std::int64_t>(options.min_free_bytes));
    response.set_queued_bytes(static_cast<std::int64_t>(status.queued_bytes));
    response.set_max_queued_bytes(static_cast<std::int64_t>(options.max_queue_bytes));
    response.set_codec(codec_to_proto(name_of(options.codec)));
    *response.mutable_max_buffer_duration() = duration_from_s(options.max_buffer_s);
    *response.mutable_buffered_duration() = duration_from_s(status.buffered_s);
    response.set_buffered_bytes(static_cast<std::int64_t>(status.buffered_bytes));
    response.set_max_buffer_bytes(static_cast<std::int64_t>(options.max_buffer_bytes));
    response.set_buffer_limited_by_memory(status.buffer_limited_by_memory);
    response.set_buffer_dropped_frame_set_count(status.buffer_dropped_frame_sets);
    return absl::OkStatus();
}

absl::Status list_recordings(const ApiContext& api, const v1::ListRecordingsRequest& request,
                             v1::ListRecordingsResponse& response) {
    const std::vector<RecordingInfo> recordings = list_recordings(api.recorder->options().folder);
    const auto page = page_of(recordings.size(), request);
    if (!page.ok()) return page.status();
    for (std::size_t i = page->first; i < page->last; ++i)
        *response.add_recordings() = to_proto(recordings[i]);
    response.set_next_page_token(page->next_token);
    return absl::OkStatus();
}

absl::Status get_recording(const ApiContext& api, const v1::GetRecordingRequest& request,
                           v1::GetRecordingResponse& response) {
    const auto info = read_recording(api.recorder->options().folder, request.name());
    if (!info.ok()) return info.status();
    *response.mutable_recording() = to_proto(*info);
    return absl::OkStatus();
}

absl::Status delete_recording(const ApiContext& api, const v1::DeleteRecordingRequest& request,
                              v1::DeleteRecordingResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return move_recording_to_bin(api.recorder->options().folder, request.name());
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::StartRecording(Context* context,
                                                                    const v1::StartRecordingRequest* request,
                                                                    v1::StartRecordingResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      start_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::StopRecording(Context* context,
                                                                   const v1::StopRecordingRequest* request,
                                                                   v1::StopRecordingResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      stop_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::SaveBuffer(Context* context,
                                                                const v1::SaveBufferRequest* request,
                                                                v1::SaveBufferResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      save_buffer);
}

// Must not queue behind calls that block on files.
RecordingServiceImpl::Reactor* RecordingServiceImpl::GetRecorderStatus(
    Context* context, const v1::GetRecorderStatusRequest* request, v1::GetRecorderStatusResponse* response) {
    return answer(context, get_recorder_status(api_, *request, *response));
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::ListRecordings(Context* context,
                                                                    const v1::ListRecordingsRequest* request,
                                                                    v1::ListRecordingsResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      list_recordings);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::GetRecording(Context* context,
                                                                  const v1::GetRecordingRequest* request,
                                                                  v1::GetRecordingResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      get_recording);
}

RecordingServiceImpl::Reactor* RecordingServiceImpl::DeleteRecording(
    Context* context, const v1::DeleteRecordingRequest* request, v1::DeleteRecordingResponse* response) {
    return unary_call(api_, api_.threads.recordings, context, request, response, check_recording,
                      delete_recording);
}

grpc::ServerWriteReactor<v1::ExportRecordingResponse>* RecordingServiceImpl::ExportRecording(
    Context* context, const v1::ExportRecordingRequest* request) {
    return ExportReactor::run(api_, context, *request);
}

}  // namespace kinevox
