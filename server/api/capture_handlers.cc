#include "server/api/capture_handlers.h"

#include <fmt/format.h>

#include <limits>

#include "server/api/to_proto.h"
#include "server/api/version.h"
#include "server/pipeline/gpu.h"
#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

void fill_newest(const ApiContext& api, const PublishedPictures& newest, v1::GetStatusResponse& response) {
    const FrameResult& result = *newest.result;
    response.set_capture_time_ns(newest.capture_time_utc_ns);
    if (result.subject) *response.mutable_subject() = to_proto(*result.subject, api.runner.cameras());
    if (!result.volume) return;
    response.mutable_volume()->set_voxels(voxel_count(*result.volume));
    response.mutable_volume()->set_voxel_m(result.volume->grid.voxel_m);
    response.mutable_volume()->set_litres(volume_litres(*result.volume));
}

void fill_cameras(const ApiContext& api, const FrameResult* result, v1::GetStatusResponse& response) {
    const std::vector<Camera>& cameras = api.runner.cameras();
    const std::vector<CameraLink> links = api.runner.camera_links();
    const bool replayed = api.replay && api.replay->status().open;  // nobody watches a recording's cameras
    const auto watched =
        api.camera_watch && !replayed ? api.camera_watch->cameras() : std::vector<WatchedCamera>{};
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        v1::CameraStatus& camera = *response.add_cameras();
        camera.set_name(cameras[i].name);
        camera.set_silhouette_iou(std::numeric_limits<double>::quiet_NaN());
        if (i < watched.size()) {
            if (watched[i].shift_px) camera.set_calibration_disagreement_px(*watched[i].shift_px);
            camera.set_calibration_suspect(watched[i].suspect);
            camera.set_calibration_suspect_reason(watched[i].reason);
        }
        if (i < links.size()) *camera.mutable_link() = to_proto(links[i]);
        if (!result) continue;
        const auto& pictures = result->frame_set.pictures;
        camera.set_has_picture(i < pictures.size() && !pictures[i].empty());
        if (result->subject)
            camera.set_used(i < result->subject->camera_used.size() && result->subject->camera_used[i]);
        if (i < result->silhouette_iou.size())
            camera.set_silhouette_iou(static_cast<double>(result->silhouette_iou[i]));
    }
}

}  // namespace

absl::Status get_status(const ApiContext& api, v1::GetStatusResponse& response) {
    const Runner::State state = api.runner.state();
    const RunFigures figures = api.runner.figures();
    response.set_version(kVersion);
    response.set_state(to_proto(state.state));
    response.set_state_message(state.message);
    if (const std::string gpu = api.gpu ? api.gpu->message() : ""; !gpu.empty())
        response.set_state_message(state.message.empty() ? gpu : state.message + "; " + gpu);
    const bool replayed = api.replay && api.replay->status().open;
    response.set_source(replayed ? "replay of " + api.replay->status().session_file.string()
                                 : api.source_description);
    response.set_uptime_ms(std::chrono::duration_cast<std::chrono::milliseconds>(
                               std::chrono::steady_clock::now() - api.started_at)
                               .count());
    response.set_source_fps(api.runner.source_fps());
    response.set_results_per_second(figures.results_per_second);
    response.set_results(figures.results);
    response.set_lost(figures.lost);
    response.set_sequence(figures.newest_sequence);
    *response.mutable_newest_times() = to_proto(figures.newest);
    *response.mutable_median_times() = to_proto(figures.median);
    response.set_total_p99_ms(figures.total_p99_ms);
    const std::shared_ptr<const PublishedPictures> newest = api.hub.newest();
    if (newest) fill_newest(api, *newest, response);
    fill_cameras(api, newest ? newest->result.get() : nullptr, response);
    if (const auto holder = api.lease.holder()) {
        response.mutable_control()->set_holder(holder->name);
        response.mutable_control()->set_remaining_ms(holder->remaining.count());
    }
    const StreamHub::Subscribers subscribers = api.hub.subscribers();
    response.set_volume_subscribers(subscribers.volumes);
    response.set_pose_subscribers(subscribers.poses);
    response.set_preview_subscribers(subscribers.pictures);
    response.set_event_subscribers(subscribers.events);
    if (api.calibration_use && !replayed) response.set_calibration_id(api.calibration_use->in_use());
    return absl::OkStatus();
}

absl::Status list_cameras(const ApiContext& api, v1::ListCamerasResponse& response) {
    for (const Camera& camera : api.runner.cameras()) *response.add_cameras() = to_proto(camera);
    return absl::OkStatus();
}

absl::Status acquire_control(const ApiContext& api, const v1::AcquireControlRequest& request,
                             v1::AcquireControlResponse& response) {
    const auto granted = api.lease.acquire(request.name(), std::chrono::milliseconds(request.timeout_ms()),
                                           request.lease_id());
    if (!granted.ok()) return granted.status();
    response.set_lease_id(granted->lease_id);
    response.set_timeout_ms(granted->timeout.count());
    if (granted->lease_id != request.lease_id())
        api.hub.publish_event(
            {EventKind::kControlTaken, 0, 0, {}, fmt::format("'{}' has control", request.name())},
            utc_now_ns());
    return absl::OkStatus();
}

absl::Status renew_control(const ApiContext& api, const v1::RenewControlRequest& request,
                           v1::RenewControlResponse& response) {
    const auto remaining = api.lease.use(request.lease_id());
    if (!remaining.ok()) return remaining.status();
    response.set_remaining_ms(remaining->count());
    return absl::OkStatus();
}

absl::Status release_control(const ApiContext& api, const v1::ReleaseControlRequest& request) {
    const auto name = api.lease.release(request.lease_id());
    if (!name.ok()) return name.status();
    api.hub.publish_event(
        {EventKind::kControlReleased, 0, 0, {}, fmt::format("'{}' has released control", *name)},
        utc_now_ns());
    return absl::OkStatus();
}

absl::Status start_capture(const ApiContext& api, const v1::StartRequest& request) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    return api.runner.start();
}

absl::Status stop_capture(const ApiContext& api, const v1::StopRequest& request) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    return api.runner.stop();
}

void learn_background(const ApiContext& api, const v1::LearnBackgroundRequest& request,
                      std::function<void(absl::Status)> done) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return done(control.status());
    api.runner.learn_background(request.frames(), std::move(done));
}

absl::Status check_watch_events(const v1::WatchEventsRequest& request) {
    if (request.past() >= 0 && request.past() <= static_cast<int>(StreamHub::kPastEvents))
        return absl::OkStatus();
    return absl::InvalidArgumentError(fmt::format("past is {}; the daemon keeps the newest {} events",
                                                  request.past(), StreamHub::kPastEvents));
}

}  // namespace kinevox
