#include "client/lib/client.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "client/lib/client_parts.h"
#include "client/lib/image.h"
#include "common/proto_time.h"
#include "common/volume_codec.h"

namespace kinevox::client {

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
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::GetStatus, v1::GetStatusRequest());
}

absl::StatusOr<std::vector<Camera>> Client::cameras() {
    const auto response = parts_->call_all_pages(*parts_->capture, &v1::CaptureService::Stub::ListCameras,
                                                 v1::ListCamerasRequest());
    if (!response.ok()) return response.status();
    std::vector<Camera> cameras;
    for (const v1::Camera& camera : response->cameras()) cameras.push_back(camera_from_proto(camera));
    return cameras;
}

absl::StatusOr<v1::AcquireControlResponse> Client::acquire_control(const v1::AcquireControlRequest& request) {
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::AcquireControl, request);
}

absl::StatusOr<v1::RenewControlResponse> Client::renew_control(const std::string& lease_id) {
    v1::RenewControlRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::RenewControl, request);
}

absl::Status Client::release_control(const std::string& lease_id) {
    v1::ReleaseControlRequest request;
    request.set_lease_id(lease_id);
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::ReleaseControl, request).status();
}

absl::Status Client::with_control(const std::string& operator_name,
                                  const std::function<absl::Status(const Lease&)>& act) {
    const auto held = HeldControl::acquire(*this, operator_name);
    return held.ok() ? act((*held)->lease()) : held.status();
}

absl::Status Client::start(const Lease& lease) {
    v1::StartCaptureRequest request;
    request.set_lease_id(lease.id);
    return parts_
        ->call(*parts_->capture, &v1::CaptureService::Stub::StartCapture, request, std::chrono::seconds(60))
        .status();
}

absl::Status Client::stop(const Lease& lease) {
    v1::StopCaptureRequest request;
    request.set_lease_id(lease.id);
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::StopCapture, request).status();
}

absl::Status Client::learn_background(const Lease& lease, int frame_set_count,
                                      std::chrono::milliseconds timeout, bool force) {
    v1::LearnBackgroundRequest request;
    request.set_lease_id(lease.id);
    request.set_frame_set_count(frame_set_count);
    request.set_force(force);
    return parts_->call(*parts_->capture, &v1::CaptureService::Stub::LearnBackground, request, timeout)
        .status();
}

absl::Status Client::start(const std::string& operator_name) {
    return with_control(operator_name, [&](const Lease& lease) { return start(lease); });
}

absl::Status Client::stop(const std::string& operator_name) {
    return with_control(operator_name, [&](const Lease& lease) { return stop(lease); });
}

absl::Status Client::learn_background(const std::string& operator_name, int frame_set_count,
                                      std::chrono::milliseconds timeout, bool force) {
    return with_control(operator_name, [&](const Lease& lease) {
        return learn_background(lease, frame_set_count, timeout, force);
    });
}

absl::Status Client::restore_background(const std::string& operator_name) {
    return with_control(operator_name, [&](const Lease& lease) {
        v1::LearnBackgroundRequest request;
        request.set_lease_id(lease.id);
        request.set_restore_previous(true);
        return parts_->call(*parts_->capture, &v1::CaptureService::Stub::LearnBackground, request).status();
    });
}

absl::Status Client::stream_volumes(const v1::StreamVolumesRequest& request,
                                    const std::function<bool(const VolumeFrame&)>& on_frame,
                                    const StreamOptions& options) {
    return read_stream<v1::StreamVolumesResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->stream->PrepareAsyncStreamVolumes(context, request, queue);
        },
        [&](const v1::StreamVolumesResponse& message) -> absl::StatusOr<bool> {
            VolumeFrame frame{message.header(), {}};
            for (const v1::SubjectVolume& subject : message.subjects()) {
                SubjectVolume& out = frame.subjects.emplace_back();
                out.subject = subject.subject();
                out.volume_litres = subject.volume_litres();
                const std::string& encoded = subject.encoded_volume();
                out.encoded_bytes = encoded.size();
                if (encoded.empty()) continue;
                auto volume =
                    decode_volume({reinterpret_cast<const std::uint8_t*>(encoded.data()), encoded.size()});
                if (!volume.ok())
                    return absl::DataLossError(
                        fmt::format("volume {} from {} cannot be decoded: {}", message.header().sequence(),
                                    parts_->options.server, std::string(volume.status().message())));
                out.volume = *std::move(volume);
            }
            return on_frame(frame);
        },
        options, parts_->options);
}

absl::Status Client::stream_poses(const v1::StreamPosesRequest& request,
                                  const std::function<bool(const v1::StreamPosesResponse&)>& on_pose,
                                  const StreamOptions& options) {
    return parts_->read(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->stream->PrepareAsyncStreamPoses(context, request, queue);
        },
        on_pose, options);
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
    return parts_->read(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->capture->PrepareAsyncWatchEvents(context, request, queue);
        },
        on_event, options);
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

namespace {

constexpr std::chrono::milliseconds kLeaseTimeout{30'000}, kMinTimeout{1'000};

}  // namespace

absl::StatusOr<std::unique_ptr<HeldControl>> HeldControl::acquire(Client& client,
                                                                  const std::string& operator_name) {
    v1::AcquireControlRequest request;
    request.set_operator_name(operator_name);
    *request.mutable_timeout() = to_duration(kLeaseTimeout);
    const auto acquired = client.acquire_control(request);
    if (!acquired.ok()) return acquired.status();
    const std::chrono::milliseconds timeout = to_milliseconds(acquired->timeout());
    return std::unique_ptr<HeldControl>(new HeldControl(client, Lease{acquired->lease_id()}, timeout));
}

HeldControl::HeldControl(Client& client, Lease lease, std::chrono::milliseconds timeout)
    : client_(client), lease_(std::move(lease)), renewal_([this, timeout](const std::stop_token& stop) {
          std::unique_lock lock(mutex_);
          while (!stopped_.wait_for(lock, stop, std::max(timeout, kMinTimeout) / 3, [] { return false; }) &&
                 !stop.stop_requested())
              client_.renew_control(lease_.id).IgnoreError();  // the next call reports what is wrong
      }) {}

HeldControl::~HeldControl() {
    renewal_.request_stop();
    renewal_.join();
    client_.release_control(lease_.id).IgnoreError();  // it may have expired
}

void keep_subject(VolumeFrame& frame, std::uint32_t subject_id) {
    if (subject_id == 0) return;
    std::erase_if(frame.subjects,
                  [&](const SubjectVolume& each) { return each.subject.subject_id() != subject_id; });
}

void keep_subject(v1::StreamPosesResponse& message, std::uint32_t subject_id) {
    if (subject_id == 0) return;
    auto& subjects = *message.mutable_subjects();
    subjects.erase(
        std::remove_if(subjects.begin(), subjects.end(),
                       [&](const v1::SubjectPose& each) { return each.subject_id() != subject_id; }),
        subjects.end());
}

}  // namespace kinevox::client
