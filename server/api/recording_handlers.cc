#include "server/api/recording_handlers.h"

#include <fmt/format.h>

#include "server/api/replay_handlers.h"

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
                fmt::format("codec is {}, which this daemon does not know", static_cast<int>(codec)));
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
    out.set_started_ns(info.about.started_utc_ns);
    out.set_seconds(info.seconds);
    out.set_fps(info.fps);
    out.set_frames(info.about.frames);
    out.set_bytes(info.bytes);
    out.set_dropped(info.about.dropped);
    out.set_lost(info.about.lost);
    out.set_missing_pictures(info.about.missing_pictures);
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
    return absl::FailedPreconditionError("this daemon has no folder for recordings; set [recording] folder");
}

absl::Status start_recording(const ApiContext& api, const v1::StartRecordingRequest& request,
                             v1::StartRecordingResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (absl::Status live = check_live(api, "what is recorded comes from"); !live.ok()) return live;
    const auto codec = codec_from_proto(request.codec());
    if (!codec.ok()) return codec.status();
    auto name = api.recorder->start(request.name(), *codec);
    if (!name.ok()) return name.status();
    response.set_name(*name);
    return absl::OkStatus();
}

absl::Status stop_recording(const ApiContext& api, const v1::StopRecordingRequest& request,
                            v1::StopRecordingResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    const auto info = api.recorder->stop();
    if (!info.ok()) return info.status();
    *response.mutable_recording() = to_proto(*info);
    return absl::OkStatus();
}

absl::Status keep_last(const ApiContext& api, const v1::KeepLastRequest& request,
                       v1::KeepLastResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (absl::Status live = check_live(api, "what is recorded comes from"); !live.ok()) return live;
    const auto info = api.recorder->keep_last(request.name(), request.seconds(), request.go_on());
    if (!info.ok()) return info.status();
    *response.mutable_recording() = to_proto(*info);
    return absl::OkStatus();
}

absl::Status get_recorder_status(const ApiContext& api, const v1::GetRecorderStatusRequest&,
                                 v1::GetRecorderStatusResponse& response) {
    if (!check_recording(api).ok()) {
        response.set_state(v1::RECORDER_STATE_OFF);
        return absl::OkStatus();
    }
    const RecorderOptions& options = api.recorder->options();
    const RecorderStatus status = api.recorder->status();
    response.set_state(to_proto(status.state));
    if (status.recording) *response.mutable_recording() = to_proto(*status.recording);
    if (status.last) *response.mutable_last() = to_proto(*status.last);
    response.set_folder(options.folder.string());
    response.set_free_bytes(static_cast<std::int64_t>(status.free_bytes));
    response.set_least_free_bytes(static_cast<std::int64_t>(options.min_free_bytes));
    response.set_queued_bytes(static_cast<std::int64_t>(status.queued_bytes));
    response.set_queue_bytes(static_cast<std::int64_t>(options.queue_bytes));
    response.set_codec(codec_to_proto(name_of(options.codec)));
    response.set_keep_last_seconds(options.keep_last_s);
    response.set_held_seconds(status.held_seconds);
    response.set_held_bytes(static_cast<std::int64_t>(status.held_bytes));
    response.set_keep_last_bytes(static_cast<std::int64_t>(options.keep_last_bytes));
    response.set_held_shortened(status.held_shortened);
    response.set_held_dropped(status.held_dropped);
    return absl::OkStatus();
}

absl::Status list_recordings(const ApiContext& api, const v1::ListRecordingsRequest&,
                             v1::ListRecordingsResponse& response) {
    for (const RecordingInfo& info : list_recordings(api.recorder->options().folder))
        *response.add_recordings() = to_proto(info);
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
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    return delete_recording(api.recorder->options().folder, request.name());
}

}  // namespace kinevox
