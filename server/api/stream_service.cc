#include "server/api/stream_service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "server/access/call_table.h"
#include "server/access/guard.h"
#include "server/api/call.h"
#include "server/api/request_arguments.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/pipeline/capture_statistics.h"

namespace kinevox {
namespace {

using VolumeReactor = StreamReactor<VolumeMailbox, grpc::ByteBuffer>;
using PoseReactor = StreamReactor<PoseMailbox, grpc::ByteBuffer>;
using PreviewReactor = StreamReactor<ImageMailbox, grpc::ByteBuffer>;

// The bytes for one subscriber, counted in the metrics.
grpc::ByteBuffer counted(const ApiContext& api, StreamStatistics CaptureStatistics::*stream,
                         std::chrono::steady_clock::time_point published_at, std::uint64_t missed_count,
                         const EncodedMessage& message) {
    const std::chrono::duration<double> latency = std::chrono::steady_clock::now() - published_at;
    if (api.statistics) (api.statistics->*stream).record(latency.count(), missed_count);
    return to_buffer(message, missed_count);
}

template <typename Request>
absl::StatusOr<Request> parse(const grpc::ByteBuffer& bytes) {
    grpc::ByteBuffer copy(bytes);  // of references
    Request request;
    if (grpc::SerializationTraits<Request>::Deserialize(&copy, &request).ok()) return request;
    return absl::InvalidArgumentError(fmt::format(
        "the request is not a valid {}; use this daemon's .proto files", Request::descriptor()->name()));
}

constexpr double kMinRate_hz = 0.001;  // the period of a lower one overflows the clock

absl::Status check_rate(double rate_hz, double max_hz) {
    if (rate_hz == 0 || (rate_hz >= kMinRate_hz && rate_hz <= max_hz)) return absl::OkStatus();
    return absl::InvalidArgumentError(
        fmt::format("max_rate_hz is {}; {} to {} messages per second are allowed, or 0 for the default",
                    rate_hz, kMinRate_hz, max_hz));
}

// Common to streams of volumes and poses.
template <typename Request>
absl::Status check_delivery(const Request& request, double max_hz) {
    if (!v1::Delivery_IsValid(request.delivery()))
        return absl::InvalidArgumentError(fmt::format("delivery {} is unknown; use LATEST_ONLY or LOSSLESS",
                                                      static_cast<int>(request.delivery())));
    if (request.delivery() == v1::DELIVERY_LOSSLESS && request.max_rate_hz() != 0)
        return absl::InvalidArgumentError(
            "a lossless stream has no rate limit; set max_rate_hz to 0 or use LATEST_ONLY");
    return check_rate(request.max_rate_hz(), max_hz);
}

template <typename Request>
MailboxOptions mailbox_options(const Request& request, const ApiContext& api) {
    if (request.delivery() != v1::DELIVERY_LOSSLESS) return {};  // the latest only
    return {MailboxOptions::WhenFull::kOverflow, api.streams.lossless_max_messages,
            api.streams.lossless_max_bytes};
}

template <typename Request>
StreamPace pace(const Request& request) {
    return {request.max_rate_hz(), request.delivery() != v1::DELIVERY_LOSSLESS};
}

absl::Status check(const v1::StreamVolumesRequest& request, double max_hz) {
    if (request.has_max_voxel_m() && !(std::isfinite(request.max_voxel_m()) && request.max_voxel_m() > 0))
        return absl::InvalidArgumentError(fmt::format(
            "max_voxel_m is {}; a voxel edge in metres, more than 0, is required", request.max_voxel_m()));
    if (request.has_downsample_level() &&
        (request.downsample_level() < 0 || request.downsample_level() > kMaxLevels))
        return absl::InvalidArgumentError(
            fmt::format("downsample_level is {}; 0 (full resolution) to {} are allowed",
                        request.downsample_level(), kMaxLevels));
    return check_delivery(request, max_hz);
}

// The guard sees methods, not requests: images require another permission than silhouettes.
absl::Status check_values(const ApiContext& api, const grpc::CallbackServerContext& context,
                          const v1::StreamPreviewsRequest& request) {
    const v1::Permission required = needed_by_values(request);
    if (!api.guard || required == v1::PERMISSION_UNSPECIFIED) return absl::OkStatus();
    return api.guard->allow(authorization_of(context), required, "StreamService.StreamPreviews");
}

absl::StatusOr<PreviewForm> preview_form(const v1::StreamPreviewsRequest& request, const ApiContext& api) {
    const std::vector<Camera>& cameras = api.runner.cameras();
    PreviewForm form;
    std::vector<std::string> names;
    for (const Camera& camera : cameras) names.push_back(camera.name);
    const auto found = std::ranges::find(names, request.camera());
    if (found == names.end())
        return absl::NotFoundError(
            fmt::format("there is no camera '{}'; cameras: {}", request.camera(), fmt::join(names, ", ")));
    form.camera = static_cast<std::size_t>(found - names.begin());
    if (!v1::StreamPreviewsRequest::Kind_IsValid(request.kind()))
        return absl::InvalidArgumentError(
            fmt::format("kind {} is unknown; use IMAGE or SILHOUETTE", static_cast<int>(request.kind())));
    form.silhouette = request.kind() == v1::StreamPreviewsRequest::KIND_SILHOUETTE;
    const auto size_ok = [](int size) { return size == 0 || (size >= 16 && size <= 8192); };
    if (!size_ok(request.max_width_px()) || !size_ok(request.max_height_px()))
        return absl::InvalidArgumentError(
            fmt::format("max_width_px is {} and max_height_px {}; 16 to 8192 are allowed, or 0",
                        request.max_width_px(), request.max_height_px()));
    form.max_width_px = request.max_width_px() ? request.max_width_px() : api.streams.preview_width_px;
    form.max_height_px = request.max_height_px();
    if (request.jpeg_quality() < 0 || request.jpeg_quality() > 100)
        return absl::InvalidArgumentError(fmt::format(
            "jpeg_quality is {}; 1 to 100 are allowed, or 0 for the default", request.jpeg_quality()));
    form.jpeg_quality = request.jpeg_quality() ? request.jpeg_quality() : api.streams.preview_jpeg_quality;
    if (const absl::Status rate = check_rate(request.max_rate_hz(), api.streams.max_rate_hz); !rate.ok())
        return rate;
    return form;
}

}  // namespace

grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamServiceImpl::StreamVolumes(
    grpc::CallbackServerContext* context, const grpc::ByteBuffer* bytes) {
    const auto request = parse<v1::StreamVolumesRequest>(*bytes);
    if (!request.ok()) return VolumeReactor::refuse(api_, to_grpc(request.status()));
    if (const absl::Status bad = check(*request, api_.streams.max_rate_hz); !bad.ok())
        return VolumeReactor::refuse(api_, to_grpc(bad));
    const MailboxOptions options = mailbox_options(*request, api_);
    return VolumeReactor::run(
        api_, context, pace(*request),
        [this, options](std::function<void()> on_ready) {
            return api_.hub.subscribe_volumes(options, std::move(on_ready));
        },
        [this, request = *request](const VolumeMailbox::Taken& taken) {
            const PublishedVolume& published = *taken.message;
            VolumeForm form{request.downsample_level(), !request.omit_colours()};
            if (request.has_max_voxel_m())
                for (const PublishedVolume::Subject& subject : published.subjects)
                    if (subject.volume)  // all have the same voxels
                        form.level = level_for(subject.volume->grid.voxel_m, request.max_voxel_m());
            return counted(api_, &CaptureStatistics::volumes, published.header.published_at, taken.missed,
                           encode(published, form, api_.runner));
        });
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamServiceImpl::StreamPoses(
    grpc::CallbackServerContext* context, const grpc::ByteBuffer* bytes) {
    const auto request = parse<v1::StreamPosesRequest>(*bytes);
    if (!request.ok()) return PoseReactor::refuse(api_, to_grpc(request.status()));
    if (const absl::Status bad = check_delivery(*request, api_.streams.max_rate_hz); !bad.ok())
        return PoseReactor::refuse(api_, to_grpc(bad));
    return PoseReactor::run(
        api_, context, pace(*request),
        [this, options = mailbox_options(*request, api_)](std::function<void()> on_ready) {
            return api_.hub.subscribe_poses(options, std::move(on_ready));
        },
        [this](const PoseMailbox::Taken& taken) {
            return counted(api_, &CaptureStatistics::poses, taken.message->header.published_at, taken.missed,
                           encode(*taken.message));
        });
}

grpc::ServerWriteReactor<grpc::ByteBuffer>* StreamServiceImpl::StreamPreviews(
    grpc::CallbackServerContext* context, const grpc::ByteBuffer* bytes) {
    const auto request = parse<v1::StreamPreviewsRequest>(*bytes);
    if (!request.ok()) return PreviewReactor::refuse(api_, to_grpc(request.status()));
    if (const absl::Status forbidden = check_values(api_, *context, *request); !forbidden.ok())
        return PreviewReactor::refuse(api_, to_grpc(forbidden));
    const absl::StatusOr<PreviewForm> form = preview_form(*request, api_);
    if (!form.ok()) return PreviewReactor::refuse(api_, to_grpc(form.status()));
    return PreviewReactor::run(
        api_, context, {request->max_rate_hz() > 0 ? request->max_rate_hz() : 10.0, true},
        [this](std::function<void()> on_ready) { return api_.hub.subscribe_images(std::move(on_ready)); },
        [this, form = *form, camera = request->camera()](const ImageMailbox::Taken& taken) {
            return counted(api_, &CaptureStatistics::images, taken.message->published_at, taken.missed,
                           encode(*taken.message, form, camera));
        });
}

}  // namespace kinevox
