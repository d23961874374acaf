#include "client/lib/client.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include "client/lib/image_file.h"
#include "client/lib/stream_reader.h"
#include "common/volume_codec.h"
#include "kinevox/v1/calibration_service.grpc.pb.h"
#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/pose_service.grpc.pb.h"
#include "kinevox/v1/recording_service.grpc.pb.h"
#include "kinevox/v1/replay_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"

namespace kinevox::client {
namespace {

constexpr std::chrono::milliseconds kLeaseTimeout{30'000};

std::shared_ptr<grpc::ChannelCredentials> credentials(const Security& security) {
    if (!security.tls) return grpc::InsecureChannelCredentials();
    return grpc::SslCredentials({.pem_root_certs = security.ca_pem,
                                 .pem_private_key = security.key_pem,
                                 .pem_cert_chain = security.certificate_pem});
}

}  // namespace

std::shared_ptr<grpc::Channel> connect(const ClientOptions& options) {
    grpc::ChannelArguments arguments;
    if (!options.security.server_name.empty())
        arguments.SetSslTargetNameOverride(options.security.server_name);
    arguments.SetMaxReceiveMessageSize(256 << 20);  // a 16-camera hall at 2 mm is large
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 20'000);
    arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 200);
    arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2'000);
    return grpc::CreateCustomChannel(options.server, credentials(options.security), arguments);
}

absl::Status to_absl(const grpc::Status& status, const std::string& server) {
    if (status.ok()) return absl::OkStatus();
    // What gRPC says of a call that reaches a server that is stopping. As CANCELLED it would be taken for a
    // leaving of the client's own: no error, no new connection.
    if (status.error_code() == grpc::StatusCode::CANCELLED)
        return absl::UnavailableError(fmt::format(
            "the daemon at {} ended the call, as it does when it stops; connect again later", server));
    const auto code = static_cast<absl::StatusCode>(status.error_code());
    std::string message = status.error_message();
    std::ranges::replace(message, '\n', ' ');
    const bool own = message.find("daemon") != std::string::npos;  // the daemon's own words, or gRPC's
    if (code == absl::StatusCode::kUnavailable && !own)
        message =
            fmt::format("cannot reach a daemon at {} ({}); start kinevoxd there or give another address",
                        server, message);
    else if (code == absl::StatusCode::kDeadlineExceeded)
        message = fmt::format("the daemon at {} did not answer in time; try again or allow it more", server);
    else if (code == absl::StatusCode::kUnimplemented)
        message =
            fmt::format("what answers at {} is not a Kinevox daemon of this version ({})", server, message);
    return {code, message};
}

struct Client::Parts {
    ClientOptions options;
    std::shared_ptr<grpc::Channel> channel;
    std::unique_ptr<v1::CaptureService::Stub> capture;
    std::unique_ptr<v1::StreamService::Stub> stream;
    std::unique_ptr<v1::PoseService::Stub> pose;
    std::unique_ptr<v1::CalibrationService::Stub> calibration;
    std::unique_ptr<v1::RecordingService::Stub> recording;
    std::unique_ptr<v1::ReplayService::Stub> replay;

    // One unary call.
    template <typename Request, typename Response>
    absl::StatusOr<Response> call(grpc::Status (v1::CaptureService::Stub::*method)(grpc::ClientContext*,
                                                                                   const Request&, Response*),
                                  const Request& request,
                                  std::optional<std::chrono::milliseconds> timeout = {}) {
        return call_on(*capture, method, request, timeout);
    }
    template <typename Stub, typename Request, typename Response>
    absl::StatusOr<Response> call_on(
        Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
        const Request& request, std::optional<std::chrono::milliseconds> timeout = {}) {
        grpc::ClientContext context;
        prepare_context(context, options);
        context.set_deadline(std::chrono::system_clock::now() + timeout.value_or(options.timeout));
        Response response;
        const grpc::Status status = (stub.*method)(&context, request, &response);
        if (!status.ok()) return to_absl(status, options.server);
        return response;
    }
};

Client::Client(const ClientOptions& options) : Client(connect(options), options) {}

Client::Client(std::shared_ptr<grpc::Channel> channel, const ClientOptions& options)
    : parts_(std::make_unique<Parts>()) {
    parts_->options = options;
    parts_->channel = std::move(channel);
    parts_->capture = v1::CaptureService::NewStub(parts_->channel);
    parts_->stream = v1::StreamService::NewStub(parts_->channel);
    parts_->pose = v1::PoseService::NewStub(parts_->channel);
    parts_->calibration = v1::CalibrationService::NewStub(parts_->channel);
    parts_->recording = v1::RecordingService::NewStub(parts_->channel);
    parts_->replay = v1::ReplayService::NewStub(parts_->channel);
}

Client::~Client() = default;
Client::Client(Client&&) noexcept = default;

absl::StatusOr<v1::GetStatusResponse> Client::status() {
    return parts_->call(&v1::CaptureService::Stub::GetStatus, v1::GetStatusRequest());
}

absl::StatusOr<std::vector<Camera>> Client::cameras() {
    const auto response = parts_->call(&v1::CaptureService::Stub::ListCameras, v1::ListCamerasRequest());
    if (!response.ok()) return response.status();
    std::vector<Camera> cameras;
    for (const v1::Camera& camera : response->cameras()) cameras.push_back(camera_from_proto(camera));
    return cameras;
}

absl::StatusOr<v1::AcquireControlResponse> Client::acquire_control(const v1::AcquireControlRequest& request) {
    return parts_->call(&v1::CaptureService::Stub::AcquireControl, request);
}

absl::StatusOr<v1::RenewControlResponse> Client::renew_control(const std::string& lease_id) {
    v1::RenewControlRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(&v1::CaptureService::Stub::RenewControl, request);
}

absl::Status Client::release_control(const std::string& lease_id) {
    v1::ReleaseControlRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(&v1::CaptureService::Stub::ReleaseControl, request).status();
}

absl::Status Client::start_with(const std::string& lease_id) {
    v1::StartRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(&v1::CaptureService::Stub::Start, request, std::chrono::seconds(60)).status();
}

absl::Status Client::stop_with(const std::string& lease_id) {
    v1::StopRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(&v1::CaptureService::Stub::Stop, request).status();
}

absl::Status Client::learn_background_with(const std::string& lease_id, int frames,
                                           std::chrono::milliseconds timeout) {
    v1::LearnBackgroundRequest request;
    request.set_lease_id(lease_id);
    request.set_frames(frames);
    return parts_->call(&v1::CaptureService::Stub::LearnBackground, request, timeout).status();
}

namespace {

// Acts under a lease of its own. The release's failure tells nothing new.
template <typename Act>
absl::Status with_control(Client& client, const std::string& operator_name, std::chrono::milliseconds timeout,
                          const Act& act) {
    v1::AcquireControlRequest request;
    request.set_name(operator_name);
    request.set_timeout_ms(timeout.count());
    const auto lease = client.acquire_control(request);
    if (!lease.ok()) return lease.status();
    const absl::Status status = act(lease->lease_id());
    client.release_control(lease->lease_id()).IgnoreError();
    return status;
}

}  // namespace

absl::Status Client::start(const std::string& operator_name) {
    return with_control(*this, operator_name, kLeaseTimeout,
                        [&](const std::string& id) { return start_with(id); });
}

absl::Status Client::stop(const std::string& operator_name) {
    return with_control(*this, operator_name, kLeaseTimeout,
                        [&](const std::string& id) { return stop_with(id); });
}

absl::Status Client::learn_background(const std::string& operator_name, int frames,
                                      std::chrono::milliseconds timeout) {
    return with_control(*this, operator_name, kLeaseTimeout,
                        [&](const std::string& id) { return learn_background_with(id, frames, timeout); });
}

absl::Status Client::stream_volumes(const v1::StreamVolumesRequest& request,
                                    const std::function<bool(const VolumeFrame&)>& on_frame,
                                    const StreamOptions& options) {
    return read_stream<v1::StreamVolumesResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->stream->PrepareAsyncStreamVolumes(context, request, queue);
        },
        [&](const v1::StreamVolumesResponse& message) -> absl::StatusOr<bool> {
            VolumeFrame frame;
            frame.header = message.header();
            frame.litres = message.litres();
            frame.bytes = message.volume().size();
            if (message.has_subject()) frame.subject = message.subject();
            if (!message.volume().empty()) {
                auto volume = decode_volume({reinterpret_cast<const std::uint8_t*>(message.volume().data()),
                                             message.volume().size()});
                if (!volume.ok())
                    return absl::DataLossError(
                        fmt::format("volume {} from {} cannot be decoded: {}", message.header().sequence(),
                                    parts_->options.server, std::string(volume.status().message())));
                frame.volume = std::move(*volume);
            }
            return on_frame(frame);
        },
        options, parts_->options);
}

absl::Status Client::stream_poses(const v1::StreamPosesRequest& request,
                                  const std::function<bool(const v1::StreamPosesResponse&)>& on_pose,
                                  const StreamOptions& options) {
    return read_stream<v1::StreamPosesResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->stream->PrepareAsyncStreamPoses(context, request, queue);
        },
        [&](const v1::StreamPosesResponse& message) -> absl::StatusOr<bool> { return on_pose(message); },
        options, parts_->options);
}

absl::Status Client::stream_previews(const v1::StreamPreviewsRequest& request,
                                     const std::function<bool(const PreviewFrame&)>& on_frame,
                                     const StreamOptions& options) {
    return read_stream<v1::StreamPreviewsResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->stream->PrepareAsyncStreamPreviews(context, request, queue);
        },
        [&](const v1::StreamPreviewsResponse& message) -> absl::StatusOr<bool> {
            PreviewFrame frame{message.header(), message.camera(), {}};
            if (!message.jpeg().empty()) {
                auto image = decode_jpeg(
                    {reinterpret_cast<const std::uint8_t*>(message.jpeg().data()), message.jpeg().size()});
                if (!image.ok()) return image.status();
                frame.image = std::move(*image);
            }
            return on_frame(frame);
        },
        options, parts_->options);
}

absl::Status Client::watch_events(const v1::WatchEventsRequest& request,
                                  const std::function<bool(const v1::WatchEventsResponse&)>& on_event,
                                  const StreamOptions& options) {
    return read_stream<v1::WatchEventsResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->capture->PrepareAsyncWatchEvents(context, request, queue);
        },
        [&](const v1::WatchEventsResponse& event) -> absl::StatusOr<bool> { return on_event(event); },
        options, parts_->options);
}

absl::StatusOr<v1::ListPosesResponse> Client::list_poses() {
    return parts_->call_on(*parts_->pose, &v1::PoseService::Stub::ListPoses, v1::ListPosesRequest());
}

namespace {

// Rendering new poses and writing the file take their time.
constexpr std::chrono::seconds kChangeTimeout{120};

template <typename Response, typename Call, typename Request>
absl::StatusOr<Response> change_under_control(Client& client, const std::string& operator_name,
                                              Request& request, const Call& call) {
    absl::StatusOr<Response> response;
    const absl::Status status =
        with_control(client, operator_name, kChangeTimeout, [&](const std::string& id) {
            request.set_lease_id(id);
            response = call();
            return response.status();
        });
    if (!status.ok()) return status;
    return response;
}

}  // namespace

absl::StatusOr<v1::AddPoseResponse> Client::add_pose(const std::string& operator_name,
                                                     v1::AddPoseRequest request) {
    return change_under_control<v1::AddPoseResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->pose, &v1::PoseService::Stub::AddPose, request, kChangeTimeout);
    });
}

absl::StatusOr<v1::RemovePoseResponse> Client::remove_pose(const std::string& operator_name,
                                                           v1::RemovePoseRequest request) {
    return change_under_control<v1::RemovePoseResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->pose, &v1::PoseService::Stub::RemovePose, request, kChangeTimeout);
    });
}

absl::StatusOr<v1::ImportBvhResponse> Client::import_bvh(const std::string& operator_name,
                                                         v1::ImportBvhRequest request) {
    return change_under_control<v1::ImportBvhResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->pose, &v1::PoseService::Stub::ImportBvh, request, kChangeTimeout);
    });
}

absl::Status Client::watch_database(const std::function<bool(const v1::WatchDatabaseResponse&)>& on_progress,
                                    const StreamOptions& options) {
    return read_stream<v1::WatchDatabaseResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->pose->PrepareAsyncWatchDatabase(context, v1::WatchDatabaseRequest(), queue);
        },
        [&](const v1::WatchDatabaseResponse& progress) -> absl::StatusOr<bool> {
            return on_progress(progress);
        },
        options, parts_->options);
}

absl::Status Client::fit_body(const std::string& operator_name, v1::FitBodyRequest request) {
    return with_control(*this, operator_name, kLeaseTimeout, [&](const std::string& id) {
        request.set_lease_id(id);
        return parts_->call_on(*parts_->pose, &v1::PoseService::Stub::FitBody, request).status();
    });
}

absl::Status Client::watch_body(const std::function<bool(const v1::WatchBodyResponse&)>& on_progress,
                                const StreamOptions& options) {
    return read_stream<v1::WatchBodyResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->pose->PrepareAsyncWatchBody(context, v1::WatchBodyRequest(), queue);
        },
        [&](const v1::WatchBodyResponse& progress) -> absl::StatusOr<bool> { return on_progress(progress); },
        options, parts_->options);
}

absl::Status Client::under_control(const std::string& operator_name,
                                   const std::function<absl::Status(const std::string& lease_id)>& act) {
    return with_control(*this, operator_name, kChangeTimeout, act);
}

absl::StatusOr<v1::OpenReplayResponse> Client::open_replay(const std::string& operator_name,
                                                           v1::OpenReplayRequest request) {
    v1::OpenReplayResponse opened;
    const auto open = [&](const std::string& lease_id) {
        request.set_lease_id(lease_id);
        auto response =
            parts_->call_on(*parts_->replay, &v1::ReplayService::Stub::OpenReplay, request, kChangeTimeout);
        if (response.ok()) opened = *std::move(response);
        return response.status();
    };
    const absl::Status done = request.lease_id().empty() ? under_control(operator_name, open)
                                                         : open(std::string(request.lease_id()));
    if (!done.ok()) return done;
    return opened;
}

absl::Status Client::close_replay(const std::string& operator_name) {
    return under_control(operator_name, [&](const std::string& lease_id) {
        v1::CloseReplayRequest request;
        request.set_lease_id(lease_id);
        return parts_
            ->call_on(*parts_->replay, &v1::ReplayService::Stub::CloseReplay, request, kChangeTimeout)
            .status();
    });
}

absl::StatusOr<v1::SetReplayResponse> Client::set_replay(const std::string& operator_name,
                                                         v1::SetReplayRequest request) {
    v1::SetReplayResponse changed;
    const auto change = [&](const std::string& lease_id) {
        request.set_lease_id(lease_id);
        auto response = parts_->call_on(*parts_->replay, &v1::ReplayService::Stub::SetReplay, request);
        if (response.ok()) changed = *std::move(response);
        return response.status();
    };
    const absl::Status done = request.lease_id().empty() ? under_control(operator_name, change)
                                                         : change(std::string(request.lease_id()));
    if (!done.ok()) return done;
    return changed;
}

absl::StatusOr<v1::GetReplayResponse> Client::get_replay() {
    return parts_->call_on(*parts_->replay, &v1::ReplayService::Stub::GetReplay, v1::GetReplayRequest());
}

absl::StatusOr<v1::StartProcedureResponse> Client::start_procedure(const v1::StartProcedureRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::StartProcedure, request);
}

absl::StatusOr<v1::AddObservationsResponse> Client::add_observations(
    const v1::AddObservationsRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::AddObservations, request);
}

absl::StatusOr<v1::SolveProcedureResponse> Client::solve_procedure(const v1::SolveProcedureRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::SolveProcedure, request);
}

absl::StatusOr<v1::CancelProcedureResponse> Client::cancel_procedure(
    const v1::CancelProcedureRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::CancelProcedure, request);
}

absl::StatusOr<v1::ListCalibrationsResponse> Client::list_calibrations(
    const v1::ListCalibrationsRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::ListCalibrations, request);
}

absl::StatusOr<v1::GetCertificateResponse> Client::get_certificate(const v1::GetCertificateRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::GetCertificate, request,
                           request.with_page() ? kChangeTimeout : parts_->options.timeout);
}

absl::StatusOr<v1::ApplyCalibrationResponse> Client::apply_calibration(
    const v1::ApplyCalibrationRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::ApplyCalibration, request,
                           kChangeTimeout);
}

absl::StatusOr<v1::UndoCalibrationResponse> Client::undo_calibration(
    const v1::UndoCalibrationRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::UndoCalibration, request,
                           kChangeTimeout);
}

absl::StatusOr<v1::ImportCalibrationResponse> Client::import_calibration(
    const v1::ImportCalibrationRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::ImportCalibration, request);
}

absl::StatusOr<v1::ExportCalibrationResponse> Client::export_calibration(
    const v1::ExportCalibrationRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::ExportCalibration, request);
}

absl::StatusOr<v1::RemoveCalibrationResponse> Client::remove_calibration(
    const v1::RemoveCalibrationRequest& request) {
    return parts_->call_on(*parts_->calibration, &v1::CalibrationService::Stub::RemoveCalibration, request);
}

absl::Status Client::watch_procedure(
    const std::function<bool(const v1::WatchProcedureResponse&)>& on_progress, const StreamOptions& options) {
    return read_stream<v1::WatchProcedureResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->calibration->PrepareAsyncWatchProcedure(context, v1::WatchProcedureRequest(),
                                                                   queue);
        },
        [&](const v1::WatchProcedureResponse& progress) -> absl::StatusOr<bool> {
            return on_progress(progress);
        },
        options, parts_->options);
}

absl::StatusOr<v1::StartRecordingResponse> Client::start_recording(const std::string& operator_name,
                                                                   v1::StartRecordingRequest request) {
    return change_under_control<v1::StartRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::StartRecording, request,
                               kLeaseTimeout);
    });
}

absl::StatusOr<v1::StopRecordingResponse> Client::stop_recording(const std::string& operator_name,
                                                                 std::chrono::milliseconds timeout) {
    v1::StopRecordingRequest request;
    return change_under_control<v1::StopRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::StopRecording, request,
                               timeout);
    });
}

absl::StatusOr<v1::KeepLastResponse> Client::keep_last(const std::string& operator_name,
                                                       v1::KeepLastRequest request,
                                                       std::chrono::milliseconds timeout) {
    return change_under_control<v1::KeepLastResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::KeepLast, request, timeout);
    });
}

absl::StatusOr<v1::DeleteRecordingResponse> Client::delete_recording(const std::string& operator_name,
                                                                     v1::DeleteRecordingRequest request) {
    return change_under_control<v1::DeleteRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::DeleteRecording, request,
                               kLeaseTimeout);
    });
}

absl::StatusOr<v1::GetRecorderStatusResponse> Client::recorder_status() {
    return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::GetRecorderStatus,
                           v1::GetRecorderStatusRequest());
}

absl::StatusOr<v1::ListRecordingsResponse> Client::list_recordings() {
    return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::ListRecordings,
                           v1::ListRecordingsRequest());
}

absl::StatusOr<v1::GetRecordingResponse> Client::get_recording(const std::string& name) {
    v1::GetRecordingRequest request;
    request.set_name(name);
    return parts_->call_on(*parts_->recording, &v1::RecordingService::Stub::GetRecording, request);
}

absl::Status Client::export_recording(v1::ExportRequest request,
                                      const std::function<bool(const v1::ExportResponse&)>& on_piece,
                                      const std::function<void(double share)>& on_progress,
                                      const StreamOptions& options) {
    request.set_progress(true);
    return read_stream<v1::ExportResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->recording->PrepareAsyncExport(context, request, queue);
        },
        [&](const v1::ExportResponse& piece) -> absl::StatusOr<bool> {
            if (!piece.file_name().empty()) return on_piece(piece);
            on_progress(piece.done_share());
            return true;
        },
        options, parts_->options);
}

Camera camera_from_proto(const v1::Camera& from) {
    Camera camera;
    camera.name = from.name();
    camera.width = from.width_px();
    camera.height = from.height_px();
    camera.fx = from.fx_px();
    camera.fy = from.fy_px();
    camera.cx = from.cx_px();
    camera.cy = from.cy_px();
    double* const distortion[] = {&camera.k1, &camera.k2, &camera.p1, &camera.p2, &camera.k3};
    for (int i = 0; i < 5 && i < from.distortion_size(); ++i) *distortion[i] = from.distortion(i);
    for (int i = 0; i < 9 && i < from.rotation_camera_from_world_size(); ++i)
        camera.camera_from_world.rotation.m[static_cast<std::size_t>(i)] = from.rotation_camera_from_world(i);
    const v1::Vec3& t = from.translation_camera_from_world();
    camera.camera_from_world.translation = {t.x(), t.y(), t.z()};
    return camera;
}

}  // namespace kinevox::client
