// CaptureService's methods about the people in the scene.
#include "common/proto_time.h"
#include "server/api/capture_service.h"
#include "server/api/request_arguments.h"
#include "server/api/to_proto.h"

namespace kinevox {
namespace {

v1::SubjectFollowing following_of(const KnownSubject& subject) {
    if (!subject.present) return v1::SUBJECT_FOLLOWING_ABSENT;
    switch (subject.followed) {
        case Followed::kYes:
            return v1::SUBJECT_FOLLOWING_FOLLOWED;
        case Followed::kOutside:
            return v1::SUBJECT_FOLLOWING_OUTSIDE;
        case Followed::kIgnored:
            return v1::SUBJECT_FOLLOWING_IGNORED;
        case Followed::kTooMany:
            break;
    }
    return v1::SUBJECT_FOLLOWING_TOO_MANY;
}

absl::StatusOr<std::shared_ptr<SubjectControl>> control_of(const ApiContext& api) {
    if (std::shared_ptr<SubjectControl> control = api.runner.subject_control()) return control;
    return absl::FailedPreconditionError(
        "the daemon has no pipeline; check its source and calibration (kinevox doctor)");
}

std::vector<std::uint32_t> ids_of(const google::protobuf::RepeatedField<std::uint32_t>& ids) {
    return {ids.begin(), ids.end()};
}

}  // namespace

absl::Status list_subjects(const ApiContext& api, const v1::ListSubjectsRequest& request,
                           v1::ListSubjectsResponse& response) {
    const auto control = control_of(api);
    if (!control.ok()) return control.status();
    const std::vector<KnownSubject> subjects = (*control)->list();
    const auto page = page_of(subjects.size(), request);
    if (!page.ok()) return page.status();
    for (std::size_t n = page->first; n < page->last; ++n) {
        const KnownSubject& subject = subjects[n];
        v1::ListedSubject& out = *response.add_subjects();
        out.set_subject_id(subject.id);
        out.set_name(subject.name);
        out.set_following(following_of(subject));
        *out.mutable_centre_in_world() = to_proto(subject.centre_in_world);
        out.set_height_m(subject.height_m);
        if (!subject.present) *out.mutable_absent_duration() = duration_from_s(subject.absent_s);
    }
    response.set_next_page_token(page->next_token);
    return absl::OkStatus();
}

absl::Status select_subjects(const ApiContext& api, const v1::SelectSubjectsRequest& request) {
    const auto control = control_of(api);
    if (!control.ok()) return control.status();
    if ((request.followed_ids_size() > 0) + (request.ignored_ids_size() > 0) + request.follow_all() != 1)
        return absl::InvalidArgumentError("set one of followed_ids, ignored_ids and follow_all");
    if (absl::Status held = use_control(api, request.lease_id()); !held.ok()) return held;
    if (request.followed_ids_size() > 0) return (*control)->follow_only(ids_of(request.followed_ids()));
    if (request.ignored_ids_size() > 0) return (*control)->ignore(ids_of(request.ignored_ids()));
    (*control)->follow_all();
    return absl::OkStatus();
}

absl::Status name_subject(const ApiContext& api, const v1::NameSubjectRequest& request) {
    const auto control = control_of(api);
    if (!control.ok()) return control.status();
    if (absl::Status held = use_control(api, request.lease_id()); !held.ok()) return held;
    return (*control)->set_name(request.subject_id(), request.name());
}

}  // namespace kinevox
