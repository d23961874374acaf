#include "server/tools/process/quality_pass.h"

#include "common/session_file.h"
#include "server/quality/camera_time.h"

namespace kinevox {

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
    if (quality::rig_is_inconsistent(rig) && !quality::is_explained_without_time(rig))
        if (const auto session = read_session(session_file_); session.ok())
            rig.time = quality::measure_camera_time(*session);
    return all;
}

quality::QualityReport QualityPass::finish(const PosePass* poses, const std::vector<PoseRow>& rows) const {
    return quality::judge_worst(measure(poses, rows));
}

}  // namespace kinevox
