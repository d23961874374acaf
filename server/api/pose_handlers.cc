#include "server/api/pose_handlers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "common/degrees.h"
#include "server/pose/database/bvh_import.h"

namespace kinevox {
namespace {

static_assert(kPoseCoordinateCount == kBodyDofCount);

// Tells the watchers, and the caller how many entries there are now.
std::int64_t publish_change(const ApiContext& api) {
    const DatabaseProgress progress = api.poses->progress();
    api.pose_watch->publish(progress);
    return progress.entries;
}

absl::StatusOr<BodyCoordinates> measured_coordinates(const ApiContext& api) {
    const auto newest = api.hub.newest();
    if (!newest || !newest->result->pose)
        return absl::FailedPreconditionError(
            "there is no measured pose at the moment; see with `kinevox status` that somebody is tracked, or "
            "give "
            "coordinates");
    return newest->result->pose->coordinates;
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
            return absl::InvalidArgumentError(fmt::format("there is no coordinate '{}'; known are {}",
                                                          name.substr(0, 80), fmt::join(names, ", ")));
    return out;
}

}  // namespace

absl::Status check_pose_database(const ApiContext& api) {
    if (api.poses && api.pose_watch) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon has no pose database; give [pose] database in its configuration, with poses enabled");
}

absl::Status list_poses(const ApiContext& api, v1::ListPosesResponse& response) {
    if (absl::Status missing = check_pose_database(api); !missing.ok()) return missing;
    const auto poses = api.poses->list();
    if (!poses.ok()) return poses.status();
    for (const PoseListing& pose : *poses) {
        v1::PoseEntry& entry = *response.add_poses();
        entry.set_label(pose.label);
        entry.set_added(pose.added);
    }
    response.set_entries(static_cast<std::int64_t>(poses->size()) * kernels::kHeadings);
    return absl::OkStatus();
}

absl::Status add_pose(const ApiContext& api, const v1::AddPoseRequest& request,
                      v1::AddPoseResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    const auto coordinates = request.coordinates_deg().empty() ? measured_coordinates(api)
                                                               : given_coordinates(request.coordinates_deg());
    if (!coordinates.ok()) return coordinates.status();
    const LibraryPose pose{request.label(), *coordinates, true};
    if (absl::Status status = api.poses->add({&pose, 1}); !status.ok()) return status;
    response.set_entries(publish_change(api));
    return absl::OkStatus();
}

absl::Status remove_pose(const ApiContext& api, const v1::RemovePoseRequest& request,
                         v1::RemovePoseResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (absl::Status status = api.poses->remove(request.label()); !status.ok()) return status;
    response.set_entries(publish_change(api));
    return absl::OkStatus();
}

absl::Status import_bvh(const ApiContext& api, const v1::ImportBvhRequest& request,
                        v1::ImportBvhResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    const double every_s = request.every_s() == 0 ? BvhImportOptions().every_s : request.every_s();
    if (!(every_s >= 0.001 && every_s <= 3600))
        return absl::InvalidArgumentError(
            fmt::format("every_s is {}; 0.001 to 3600 is allowed, or 0 for the default", every_s));
    const auto poses = api.poses->import_bvh(request.bvh(), request.label(), every_s);
    if (!poses.ok()) return poses.status();
    response.set_poses(*poses);
    response.set_entries(publish_change(api));
    return absl::OkStatus();
}

absl::Status check_body_fit(const ApiContext& api) {
    if (api.body_fit && api.body_watch) return absl::OkStatus();
    return absl::FailedPreconditionError(
        "this daemon measures no poses; enable them under [pose] in its configuration");
}

absl::Status fit_body(const ApiContext& api, const v1::FitBodyRequest& request) {
    if (absl::Status missing = check_body_fit(api); !missing.ok()) return missing;
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (api.runner.state().state != RunState::kRunning)
        return absl::FailedPreconditionError(
            "the capture does not run; start it to fit the body of whoever is seen");
    return api.body_fit->start(request.seconds() == 0 ? LiveBodyFit::kUsualSeconds : request.seconds());
}

v1::WatchBodyResponse to_proto(const BodyFitProgress& progress) {
    v1::WatchBodyResponse out;
    switch (progress.state) {
        case BodyFitState::kNone:
            out.set_state(v1::BODY_FIT_STATE_NONE);
            break;
        case BodyFitState::kCollecting:
            out.set_state(v1::BODY_FIT_STATE_COLLECTING);
            break;
        case BodyFitState::kFitting:
            out.set_state(v1::BODY_FIT_STATE_FITTING);
            break;
        case BodyFitState::kReady:
            out.set_state(v1::BODY_FIT_STATE_READY);
            break;
        case BodyFitState::kFailed:
            out.set_state(v1::BODY_FIT_STATE_FAILED);
            break;
    }
    out.set_part(progress.part);
    out.set_asked(progress.asked);
    out.set_message(progress.message);
    v1::Body& body = *out.mutable_body();
    const auto set = [](v1::BodyMeasure& measure, std::string_view name, double value_m,
                        std::optional<double> std_m) {
        measure.set_name(std::string(name));
        measure.set_value_m(value_m);
        if (std_m) measure.set_std_m(*std_m);
    };
    const auto& fit = progress.fit;
    set(*body.mutable_stature(), "stature", progress.body.stature_m,
        fit ? std::optional(fit->stature_std_m) : std::nullopt);
    for (int k = 0; k < kBodyLengthCount; ++k)
        set(*body.add_lengths(), kBodyLengths[k].name, progress.body.lengths_m[k],
            fit ? std::optional(fit->lengths_std_m[k]) : std::nullopt);
    for (const BodyGirthInfo& girth : kBodyGirths)
        set(*body.add_girths(), girth.name, girth_m(progress.body, girth),
            fit ? std::optional(girth_std_m(*fit, girth)) : std::nullopt);
    if (!fit) return out;
    body.set_frames(fit->frames);
    body.set_contour_rms_m(fit->contour_rms_m);
    body.set_stored_in(progress.stored_in.string());
    return out;
}

v1::WatchDatabaseResponse to_proto(const DatabaseProgress& progress) {
    v1::WatchDatabaseResponse out;
    switch (progress.state) {
        case DatabaseState::kNone:
            out.set_state(v1::DATABASE_STATE_NONE);
            break;
        case DatabaseState::kBuilding:
            out.set_state(v1::DATABASE_STATE_BUILDING);
            break;
        case DatabaseState::kReady:
            out.set_state(v1::DATABASE_STATE_READY);
            break;
        case DatabaseState::kCancelled:
            out.set_state(v1::DATABASE_STATE_CANCELLED);
            break;
        case DatabaseState::kFailed:
            out.set_state(v1::DATABASE_STATE_FAILED);
            break;
    }
    out.set_part(progress.part);
    out.set_entries(progress.entries);
    out.set_message(progress.message);
    return out;
}

}  // namespace kinevox
