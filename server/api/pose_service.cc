#include "server/api/pose_service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common/geometry.h"
#include "common/proto_time.h"
#include "server/api/call.h"
#include "server/api/request_arguments.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/pose/database/bvh_import.h"

namespace kinevox {
namespace {

// Publishes the database's state and returns its number of entries.
std::int64_t publish_change(const ApiContext& api) {
    const DatabaseProgress progress = api.poses.database->progress();
    api.poses.database_watch->publish(progress);
    return progress.entry_count;
}

std::vector<std::uint32_t> tracked_subjects(const ApiContext& api) {
    const auto latest = api.hub.latest();
    std::vector<std::uint32_t> ids;
    if (latest)
        for (const SubjectResult& subject : latest->result->subjects) ids.push_back(subject.track.subject_id);
    return ids;
}

absl::StatusOr<BodyCoordinates> measured_coordinates(const ApiContext& api, std::uint32_t requested_subject) {
    const auto latest = api.hub.latest();
    const auto subject = choose_subject(requested_subject, tracked_subjects(api));
    if (!subject.ok()) return subject.status();
    const SubjectResult* found = nullptr;
    if (latest)
        for (const SubjectResult& each : latest->result->subjects)
            if (each.track.subject_id == *subject) found = &each;
    if (!found || !found->pose)
        return absl::FailedPreconditionError(
            "no pose is being measured; check with `kinevox status` that a subject is tracked, or set "
            "coordinates_deg");
    return found->pose->coordinates;
}

absl::StatusOr<BodyCoordinates> given_coordinates(const google::protobuf::Map<std::string, double>& given) {
    BodyCoordinates out{};
    std::size_t known = 0;
    for (int dof = kDofRootRotation; dof < kBodyDofCount; ++dof) {
        const auto found = given.find(std::string(kBodyDofs[dof].name));
        if (found == given.end()) continue;
        out[dof] = radians(found->second);
        ++known;
        const auto& [name, lower, upper] = kBodyDofs[dof];
        if (!std::isfinite(out[dof]) || !(out[dof] >= lower && out[dof] <= upper))
            return absl::InvalidArgumentError(fmt::format("{} is {} deg; {:.0f} to {:.0f} is allowed", name,
                                                          found->second, degrees(lower), degrees(upper)));
    }
    if (known == given.size()) return out;
    std::vector<std::string_view> names;
    for (int dof = kDofRootRotation; dof < kBodyDofCount; ++dof) names.push_back(kBodyDofs[dof].name);
    for (const auto& [name, value] : given)
        if (std::ranges::find(names, name) == names.end())
            return absl::InvalidArgumentError(fmt::format("there is no coordinate '{}'; coordinates: {}",
                                                          name.substr(0, 80), fmt::join(names, ", ")));
    return out;
}

v1::BodyFitState to_proto(BodyFitState state) {
    switch (state) {
        case BodyFitState::kNotStarted:
            return v1::BODY_FIT_STATE_NOT_STARTED;
        case BodyFitState::kCollecting:
            return v1::BODY_FIT_STATE_COLLECTING;
        case BodyFitState::kFitting:
            return v1::BODY_FIT_STATE_FITTING;
        case BodyFitState::kReady:
            return v1::BODY_FIT_STATE_READY;
        case BodyFitState::kFailed:
            return v1::BODY_FIT_STATE_FAILED;
    }
    return v1::BODY_FIT_STATE_UNSPECIFIED;
}

v1::PoseDatabaseState to_proto(PoseDatabaseState state) {
    switch (state) {
        case PoseDatabaseState::kNotStarted:
            return v1::POSE_DATABASE_STATE_NOT_STARTED;
        case PoseDatabaseState::kBuilding:
            return v1::POSE_DATABASE_STATE_BUILDING;
        case PoseDatabaseState::kReady:
            return v1::POSE_DATABASE_STATE_READY;
        case PoseDatabaseState::kCancelled:
            return v1::POSE_DATABASE_STATE_CANCELLED;
        case PoseDatabaseState::kFailed:
            return v1::POSE_DATABASE_STATE_FAILED;
    }
    return v1::POSE_DATABASE_STATE_UNSPECIFIED;
}

v1::BodyMeasurement measurement(std::string_view name, double value_m, std::optional<double> std_m) {
    v1::BodyMeasurement out;
    out.set_name(std::string(name));
    out.set_value_m(value_m);
    if (std_m) out.set_std_m(*std_m);
    return out;
}

v1::Body to_proto(const BodyShape& shape, const std::optional<BodyFit>& fit, const std::string& stored_path) {
    v1::Body body;
    *body.mutable_stature() =
        measurement("stature", shape.stature_m, fit ? std::optional(fit->stature_std_m) : std::nullopt);
    for (int k = 0; k < kBodyLengthCount; ++k)
        *body.add_lengths() = measurement(kBodyLengths[k].name, shape.lengths_m[k],
                                          fit ? std::optional(fit->lengths_std_m[k]) : std::nullopt);
    for (const BodyGirthInfo& girth : kBodyGirths)
        *body.add_girths() = measurement(girth.name, girth_m(shape, girth),
                                         fit ? std::optional(girth_std_m(*fit, girth)) : std::nullopt);
    if (!fit) return body;
    body.set_frame_set_count(fit->frame_set_count);
    body.set_contour_residual_rms_m(fit->contour_residual_rms_m);
    body.set_stored_path(stored_path);
    return body;
}

}  // namespace

absl::Status check_pose_database(const ApiContext& api) {
    if (api.poses.database && api.poses.database_watch) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon has no pose database; set [pose] database in its configuration and enable poses");
}

absl::Status list_library_poses(const ApiContext& api, const v1::ListLibraryPosesRequest& request,
                                v1::ListLibraryPosesResponse& response) {
    if (absl::Status missing = check_pose_database(api); !missing.ok()) return missing;
    const auto poses = api.poses.database->list();
    if (!poses.ok()) return poses.status();
    const auto page = page_of(poses->size(), request);
    if (!page.ok()) return page.status();
    for (std::size_t i = page->first; i < page->last; ++i) {
        v1::LibraryPose& pose = *response.add_poses();
        pose.set_label((*poses)[i].label);
        pose.set_user_defined((*poses)[i].user_defined);
    }
    response.set_entry_count(static_cast<std::int64_t>(poses->size()) * kernels::kHeadings);
    response.set_next_page_token(page->next_token);
    return absl::OkStatus();
}

absl::Status add_library_pose(const ApiContext& api, const v1::AddLibraryPoseRequest& request,
                              v1::AddLibraryPoseResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    const auto coordinates = request.coordinates_deg().empty()
                                 ? measured_coordinates(api, request.subject_id())
                                 : given_coordinates(request.coordinates_deg());
    if (!coordinates.ok()) return coordinates.status();
    const LibraryPose pose{request.label(), *coordinates, true};
    if (absl::Status status = api.poses.database->add({&pose, 1}); !status.ok()) return status;
    response.set_entry_count(publish_change(api));
    return absl::OkStatus();
}

absl::Status delete_library_pose(const ApiContext& api, const v1::DeleteLibraryPoseRequest& request,
                                 v1::DeleteLibraryPoseResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status status = api.poses.database->remove(request.label()); !status.ok()) return status;
    response.set_entry_count(publish_change(api));
    return absl::OkStatus();
}

absl::Status import_library_poses(const ApiContext& api, const v1::ImportLibraryPosesRequest& request,
                                  v1::ImportLibraryPosesResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    const double interval_s =
        request.has_interval() ? to_seconds(request.interval()) : BvhImportOptions().interval_s;
    if (!(interval_s >= 0.001 && interval_s <= 3600))
        return absl::InvalidArgumentError(fmt::format(
            "interval is {} s; 0.001 s to 3600 s are allowed, or none for the default", interval_s));
    const auto pose_count = api.poses.database->import_bvh(request.data(), request.label(), interval_s);
    if (!pose_count.ok()) return pose_count.status();
    response.set_pose_count(*pose_count);
    response.set_entry_count(publish_change(api));
    return absl::OkStatus();
}

v1::WatchPoseDatabaseResponse to_proto(const DatabaseProgress& progress) {
    v1::WatchPoseDatabaseResponse out;
    out.set_state(to_proto(progress.state));
    out.set_progress(progress.progress);
    out.set_message(progress.message);
    out.set_entry_count(progress.entry_count);
    return out;
}

absl::Status check_body_fit(const ApiContext& api) {
    if (api.poses.body_fit && api.poses.body_watch) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon measures no poses; enable them under [pose] in its configuration");
}

absl::Status fit_body(const ApiContext& api, const v1::FitBodyRequest& request) {
    if (absl::Status missing = check_body_fit(api); !missing.ok()) return missing;
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (api.runner.state().state != RunState::kRunning)
        return absl::FailedPreconditionError(
            "the capture is not running; start it to fit the subject's body");
    const auto subject = choose_subject(request.subject_id(), tracked_subjects(api));
    if (!subject.ok()) return subject.status();
    return api.poses.body_fit->start(
        *subject, request.has_duration() ? to_seconds(request.duration()) : LiveBodyFit::kDefaultSeconds);
}

v1::WatchBodyResponse body_to_proto(const std::vector<BodyFitProgress>& subjects) {
    v1::WatchBodyResponse out;
    for (const BodyFitProgress& progress : subjects) {
        v1::SubjectBody& subject = *out.add_subjects();
        subject.set_subject_id(progress.subject_id);
        subject.set_state(to_proto(progress.state));
        subject.set_progress(progress.progress);
        subject.set_requested(progress.requested);
        subject.set_message(progress.message);
        *subject.mutable_body() = to_proto(progress.body, progress.fit, progress.stored_path.string());
    }
    return out;
}

using DatabaseReactor = StreamReactor<DatabaseWatch::Box, v1::WatchPoseDatabaseResponse>;
using BodyReactor = StreamReactor<BodyWatch::Box, v1::WatchBodyResponse>;

PoseServiceImpl::Reactor* PoseServiceImpl::ListLibraryPoses(Context* context,
                                                            const v1::ListLibraryPosesRequest* request,
                                                            v1::ListLibraryPosesResponse* response) {
    return answer(context, list_library_poses(api_, *request, *response));
}

PoseServiceImpl::Reactor* PoseServiceImpl::AddLibraryPose(Context* context,
                                                          const v1::AddLibraryPoseRequest* request,
                                                          v1::AddLibraryPoseResponse* response) {
    return unary_call(api_, api_.threads.changes, context, request, response, check_pose_database,
                      add_library_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::DeleteLibraryPose(Context* context,
                                                             const v1::DeleteLibraryPoseRequest* request,
                                                             v1::DeleteLibraryPoseResponse* response) {
    return unary_call(api_, api_.threads.changes, context, request, response, check_pose_database,
                      delete_library_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::ImportLibraryPoses(Context* context,
                                                              const v1::ImportLibraryPosesRequest* request,
                                                              v1::ImportLibraryPosesResponse* response) {
    return unary_call(api_, api_.threads.changes, context, request, response, check_pose_database,
                      import_library_poses);
}

grpc::ServerWriteReactor<v1::WatchPoseDatabaseResponse>* PoseServiceImpl::WatchPoseDatabase(
    Context* context, const v1::WatchPoseDatabaseRequest*) {
    if (const absl::Status missing = check_pose_database(api_); !missing.ok())
        return DatabaseReactor::refuse(api_, to_grpc(missing));
    return DatabaseReactor::run(
        api_, context, {},
        [this](std::function<void()> on_ready) {
            return api_.poses.database_watch->subscribe(std::move(on_ready));
        },
        [](const DatabaseWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

PoseServiceImpl::Reactor* PoseServiceImpl::FitBody(Context* context, const v1::FitBodyRequest* request,
                                                   v1::FitBodyResponse*) {
    return answer(context, fit_body(api_, *request));
}

grpc::ServerWriteReactor<v1::WatchBodyResponse>* PoseServiceImpl::WatchBody(Context* context,
                                                                            const v1::WatchBodyRequest*) {
    if (const absl::Status missing = check_body_fit(api_); !missing.ok())
        return BodyReactor::refuse(api_, to_grpc(missing));
    return BodyReactor::run(
        api_, context, {},
        [this](std::function<void()> on_ready) {
            return api_.poses.body_watch->subscribe(std::move(on_ready));
        },
        [](const BodyWatch::Box::Taken& taken) { return body_to_proto(taken.message); });
}

}  // namespace kinevox
