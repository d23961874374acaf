#include "server/tools/process/quality_pass.h"

#include <set>

#include "common/session_file.h"
#include "server/quality/camera_time.h"

namespace kinevox {
namespace {

// Id 0: the name that all subjects of the rows have.
std::string name_of_rows(const SubjectNames& names, std::uint32_t id, const std::vector<PoseRow>& rows) {
    if (names.empty()) return {};
    if (id != 0) return subject_name(names, id);
    std::set<std::uint32_t> ids;
    for (const PoseRow& row : rows)
        if (row.subject_id != 0) ids.insert(row.subject_id);
    return common_subject_name(names, ids);
}

}  // namespace

std::vector<quality::Measurements> QualityPass::measure(const PosePass* poses,
                                                        const std::vector<PoseRow>& rows) const {
    std::vector<quality::PosedSubject> subjects;
    if (poses)
        for (const std::uint32_t id : poses->followed_subjects()) {
            quality::PosedSubject& subject = subjects.emplace_back();
            subject.id = id;
            subject.body = poses->body_of(id);
            for (const PoseRow& row : rows)
                if (id == 0 || row.subject_id == id) subject.poses.push_back({row.frame, row.pose});
        }
    std::vector<quality::Measurements> all = observer_.measure(subjects, poses && poses->subjects_selected());
    for (quality::Measurements& seen : all) {
        const BodyFit* const fit = poses ? poses->fit_of(seen.subject_id) : nullptr;
        seen.body.feet_unseen = fit && fit->standing_m > 0;
        if (!poses || !poses->body_given()) continue;
        seen.body.given = true;
        if (fit) seen.body.fitted_stature_m = fit->shape.stature_m;
    }
    quality::RigMeasurements& rig = all.front().rig;
    if (quality::time_is_doubtful(rig))
        if (const auto session = read_session(session_file_); session.ok())
            rig.time = quality::measure_camera_time(*session);
    return all;
}

quality::QualityReport QualityPass::finish(const PosePass* poses, const std::vector<PoseRow>& rows,
                                           const SubjectNames& names) const {
    std::vector<quality::Measurements> all = measure(poses, rows);
    for (quality::Measurements& seen : all) seen.subject_name = name_of_rows(names, seen.subject_id, rows);
    return quality::judge_worst(all);
}

}  // namespace kinevox
