#include "server/api/capture_service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <boost/asio/post.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "common/proto_time.h"
#include "server/api/call.h"
#include "server/api/request_arguments.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/pipeline/gpu.h"
#include "server/quality/live_quality.h"

namespace kinevox {
namespace {

void fill_subjects(const ApiContext& api, const FrameResult& result, v1::GetStatusResponse& response) {
    for (const SubjectResult& one : result.subjects) {
        v1::SubjectStatus& subject = *response.add_subjects();
        *subject.mutable_subject() = to_proto(one.track, api.runner.cameras());
        subject.set_pose_found(one.pose != nullptr);
        if (!one.volume) continue;
        v1::VolumeSummary& volume = *subject.mutable_volume();
        volume.set_voxel_count(voxel_count(*one.volume));
        volume.set_voxel_m(one.volume->grid.voxel_m);
        volume.set_volume_litres(volume_litres(*one.volume));
    }
}

void fill_camera_subject(const FrameResult& result, std::size_t i, v1::CameraStatus& camera) {
    for (const SubjectResult& one : result.subjects) {
        v1::CameraSubjectStatus& subject = *camera.add_subjects();
        subject.set_subject_id(one.track.subject_id);
        subject.set_used(i < one.track.used_cameras.size() && one.track.used_cameras[i]);
        if (i < one.silhouette_iou.size() && std::isfinite(one.silhouette_iou[i]))
            subject.set_silhouette_iou(static_cast<double>(one.silhouette_iou[i]));
    }
}

void fill_cameras(const ApiContext& api, const FrameResult* result, v1::GetStatusResponse& response) {
    const std::vector<Camera>& cameras = api.runner.cameras();
    const std::vector<CameraConnection> connections = api.runner.camera_connections();
    const bool replayed = api.replay && api.replay->status().open;  // a recording's cameras are not watched
    const auto watched = api.calibration.camera_watch && !replayed ? api.calibration.camera_watch->cameras()
                                                                   : std::vector<WatchedCamera>{};
    for (std::size_t i = 0; i < cameras.size(); ++i) {
        v1::CameraStatus& camera = *response.add_cameras();
        camera.set_name(cameras[i].name);
        if (i < watched.size()) {
            if (watched[i].shift_px) camera.set_scene_shift_px(*watched[i].shift_px);
            camera.set_calibration_suspect(watched[i].suspect);
            camera.set_calibration_suspect_reason(watched[i].reason);
        }
        if (i < connections.size()) *camera.mutable_connection() = to_proto(connections[i]);
        if (!result) continue;
        const auto& images = result->frame_set.images;
        camera.set_has_image(i < images.size() && !images[i].empty());
        fill_camera_subject(*result, i, camera);
    }
}

std::string subjects_are(const std::vector<SubjectResult>& subjects) {
    if (subjects.size() == 1) return fmt::format("subject {} is", subjects.front().track.subject_id);
    std::vector<std::uint32_t> ids;
    for (const SubjectResult& subject : subjects) ids.push_back(subject.track.subject_id);
    return fmt::format("subjects {} are", fmt::join(ids, ", "));
}

void fill_rates(const ApiContext& api, v1::GetStatusResponse& response) {
    const RunSnapshot snapshot = api.runner.snapshot();
    response.set_nominal_fps(api.runner.source_fps());
    response.set_result_rate_hz(snapshot.result_rate_hz);
    response.set_result_count(snapshot.result_count);
    response.set_lost_frame_set_count(snapshot.lost_count);
    response.set_latest_sequence(snapshot.latest_sequence);
    *response.mutable_latest_stage_times() = to_proto(snapshot.latest);
    *response.mutable_median_stage_times() = to_proto(snapshot.median);
    response.set_total_p99_ms(snapshot.total_p99_ms);
}

void fill_subscribers(const ApiContext& api, v1::GetStatusResponse& response) {
    const StreamHub::Subscribers subscribers = api.hub.subscribers();
    response.set_volume_subscriber_count(subscribers.volumes);
    response.set_pose_subscriber_count(subscribers.poses);
    response.set_preview_subscriber_count(subscribers.images);
    response.set_event_subscriber_count(subscribers.events);
}

using EventReactor = StreamReactor<EventMailbox, v1::WatchEventsResponse>;

// Every daemon captures.
absl::Status always(const ApiContext&) {
    return absl::OkStatus();
}

v1::ResultTrust to_proto(quality::Trust trust) {
    return trust == quality::Trust::kGood      ? v1::RESULT_TRUST_GOOD
           : trust == quality::Trust::kCaution ? v1::RESULT_TRUST_CAUTION
                                               : v1::RESULT_TRUST_DO_NOT_USE;
}

void fill_quality(const quality::QualityReport& report, v1::ResultQuality& out) {
    const quality::Measurements& seen = report.measurements;
    out.set_trust(to_proto(report.verdict));
    out.set_frame_set_count(seen.frame_sets);
    out.set_withheld_fraction(seen.pose.withheld_fraction);
    if (seen.pose.posed_iou) out.set_posed_iou(*seen.pose.posed_iou);
    if (seen.rig.hull_iou) out.set_hull_iou(*seen.rig.hull_iou);
    if (seen.pose.joint_std_m) out.set_joint_std_m(*seen.pose.joint_std_m);
    if (report.causes.empty()) return;
    const quality::Cause& cause = report.causes.front();
    out.set_cause(cause.cause);
    out.set_camera(cause.camera);
    out.set_reason(cause.reason);
    out.set_remedy(cause.remedy);
}

}  // namespace

absl::Status get_status(const ApiContext& api, v1::GetStatusResponse& response) {
    const Runner::State state = api.runner.state();
    response.set_version(KINEVOX_VERSION);
    response.set_state(to_proto(state.state));
    response.set_state_message(state.message);
    if (const std::string gpu = api.gpu ? api.gpu->message() : ""; !gpu.empty())
        response.set_state_message(state.message.empty() ? gpu : state.message + "; " + gpu);
    const bool replayed = api.replay && api.replay->status().open;
    response.set_source(replayed ? "replay of " + api.replay->status().session_file.string()
                                 : api.source_description);
    *response.mutable_uptime() = to_duration(std::chrono::steady_clock::now() - api.started_at);
    fill_rates(api, response);
    const std::shared_ptr<const PublishedImages> latest = api.hub.latest();
    if (latest) {
        response.set_latest_capture_time_ns(latest->capture_time_utc_ns);
        fill_subjects(api, *latest->result, response);
    }
    fill_cameras(api, latest ? latest->result.get() : nullptr, response);
    if (const auto holder = api.lease.holder()) {
        v1::ControlLease& lease = *response.mutable_control_lease();
        lease.set_operator_name(holder->operator_name);
        *lease.mutable_remaining_duration() = to_duration(holder->remaining);
    }
    fill_subscribers(api, response);
    if (api.calibration.active && !replayed)
        response.set_active_calibration_id(api.calibration.active->active());
    if (const auto report = api.quality && !replayed ? api.quality->report() : nullptr)
        fill_quality(*report, *response.mutable_quality());
    return absl::OkStatus();
}

absl::Status list_cameras(const ApiContext& api, const v1::ListCamerasRequest& request,
                          v1::ListCamerasResponse& response) {
    const std::vector<Camera> cameras = api.runner.cameras();
    const auto page = page_of(cameras.size(), request);
    if (!page.ok()) return page.status();
    for (std::size_t i = page->first; i < page->last; ++i) *response.add_cameras() = to_proto(cameras[i]);
    response.set_next_page_token(page->next_token);
    return absl::OkStatus();
}

absl::Status acquire_control(const ApiContext& api, const v1::AcquireControlRequest& request,
                             v1::AcquireControlResponse& response) {
    const auto granted =
        api.lease.acquire(request.operator_name(), to_milliseconds(request.timeout()), request.lease_id());
    if (!granted.ok()) return granted.status();
    response.set_lease_id(granted->lease_id);
    *response.mutable_timeout() = to_duration(granted->timeout);
    if (granted->lease_id != request.lease_id())
        api.hub.events().publish(EventKind::kControlAcquired,
                                 fmt::format("'{}' has acquired control", request.operator_name()));
    return absl::OkStatus();
}

absl::Status renew_control(const ApiContext& api, const v1::RenewControlRequest& request,
                           v1::RenewControlResponse& response) {
    const auto remaining = api.lease.use(request.lease_id());
    if (!remaining.ok()) return remaining.status();
    *response.mutable_remaining_duration() = to_duration(*remaining);
    return absl::OkStatus();
}

absl::Status release_control(const ApiContext& api, const v1::ReleaseControlRequest& request,
                             v1::ReleaseControlResponse&) {
    const auto operator_name = api.lease.release(request.lease_id());
    if (!operator_name.ok()) return operator_name.status();
    api.hub.events().publish(EventKind::kControlReleased,
                             fmt::format("'{}' has released control", *operator_name));
    return absl::OkStatus();
}

absl::Status start_capture(const ApiContext& api, const v1::StartCaptureRequest& request,
                           v1::StartCaptureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.runner.start();
}

absl::Status stop_capture(const ApiContext& api, const v1::StopCaptureRequest& request,
                          v1::StopCaptureResponse&) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.runner.stop();
}

void learn_background(const ApiContext& api, const v1::LearnBackgroundRequest& request,
                      std::function<void(absl::Status)> done) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return done(control);
    if (request.restore_previous()) {
        if (request.frame_set_count() != 0)
            return done(
                absl::InvalidArgumentError("restore_previous needs no frame sets; set frame_set_count to 0 "
                                           "or leave restore_previous out"));
        return done(api.runner.restore_background());
    }
    const auto latest = api.hub.latest();
    if (request.frame_set_count() > 0 && !request.force() && latest && !latest->result->subjects.empty() &&
        api.runner.state().state == RunState::kRunning)
        return done(absl::FailedPreconditionError(
            fmt::format("{} tracked and would become part of the background; clear the scene, or force it "
                        "(kinevox learn-background --force) if that is not a person",
                        subjects_are(latest->result->subjects))));
    api.runner.learn_background(request.frame_set_count(), std::move(done));
}

absl::Status check_watch_events(const v1::WatchEventsRequest& request) {
    if (request.history_count() >= 0 && request.history_count() <= static_cast<int>(EventLog::kMaxHistory))
        return absl::OkStatus();
    return absl::InvalidArgumentError(
        fmt::format("history_count is {}; the daemon keeps the latest {} events", request.history_count(),
                    EventLog::kMaxHistory));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::GetStatus(Context* context, const v1::GetStatusRequest*,
                                                           v1::GetStatusResponse* response) {
    return answer(context, get_status(api_, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::ListCameras(Context* context,
                                                             const v1::ListCamerasRequest* request,
                                                             v1::ListCamerasResponse* response) {
    return answer(context, list_cameras(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::ListSubjects(Context* context,
                                                              const v1::ListSubjectsRequest* request,
                                                              v1::ListSubjectsResponse* response) {
    return answer(context, list_subjects(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::SelectSubjects(Context* context,
                                                                const v1::SelectSubjectsRequest* request,
                                                                v1::SelectSubjectsResponse*) {
    return answer(context, select_subjects(api_, *request));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::NameSubject(Context* context,
                                                             const v1::NameSubjectRequest* request,
                                                             v1::NameSubjectResponse*) {
    return answer(context, name_subject(api_, *request));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::StartCapture(Context* context,
                                                              const v1::StartCaptureRequest* request,
                                                              v1::StartCaptureResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, always, start_capture);
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::StopCapture(Context* context,
                                                             const v1::StopCaptureRequest* request,
                                                             v1::StopCaptureResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, always, stop_capture);
}

// Its handler finishes later than it returns.
CaptureServiceImpl::Reactor* CaptureServiceImpl::LearnBackground(Context* context,
                                                                 const v1::LearnBackgroundRequest* request,
                                                                 v1::LearnBackgroundResponse*) {
    Reactor* reactor = context->DefaultReactor();
    boost::asio::post(api_.threads.control, [this, reactor, request = *request] {
        learn_background(api_, request, [reactor](absl::Status status) { reactor->Finish(to_grpc(status)); });
    });
    return reactor;
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::AcquireControl(Context* context,
                                                                const v1::AcquireControlRequest* request,
                                                                v1::AcquireControlResponse* response) {
    return answer(context, acquire_control(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::RenewControl(Context* context,
                                                              const v1::RenewControlRequest* request,
                                                              v1::RenewControlResponse* response) {
    return answer(context, renew_control(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::ReleaseControl(Context* context,
                                                                const v1::ReleaseControlRequest* request,
                                                                v1::ReleaseControlResponse* response) {
    return answer(context, release_control(api_, *request, *response));
}

grpc::ServerWriteReactor<v1::WatchEventsResponse>* CaptureServiceImpl::WatchEvents(
    Context* context, const v1::WatchEventsRequest* request) {
    if (const absl::Status bad = check_watch_events(*request); !bad.ok())
        return EventReactor::refuse(api_, to_grpc(bad));
    return EventReactor::run(
        api_, context, {},
        [this,
         history_count = static_cast<std::size_t>(request->history_count())](std::function<void()> on_ready) {
            return api_.hub.events().subscribe(history_count, std::move(on_ready));
        },
        [](const EventMailbox::Taken& taken) { return to_proto(taken.message, taken.missed); });
}

}  // namespace kinevox
