#include "server/tools/process/quality_pass.h"

#include "common/session_file.h"
#include "server/quality/camera_time.h"

namespace kinevox {

quality::Measurements QualityPass::measure(const PosePass* poses, const std::vector<PoseRow>& rows) const {
    std::vector<quality::PosedFrame> posed;
    const std::uint32_t main = poses ? poses->main_subject() : 0;  // one body is judged
    for (const PoseRow& row : rows)
        if (main == 0 || row.subject_id == main) posed.push_back({row.frame, row.pose});
    const BodyShape* const body = poses ? poses->body() : nullptr;
    quality::Measurements seen = observer_.measure(posed, body);
    if (poses) {
        seen.followed_subjects = poses->followed_subjects();
        seen.subjects_selected = poses->subjects_selected();
    }
    if (seen.followed_subjects > 1 || seen.subjects_selected) {
        // These compare the silhouettes of all people with one body.
        seen.rig = {.side_px = seen.rig.side_px};
        seen.world.subject_height_m = seen.world.max_height_m = seen.world.lowest_m = std::nullopt;
        seen.pose.posed_iou = std::nullopt;
    }
    seen.body.feet_unseen = poses && poses->fit() && poses->fit()->standing_m > 0;
    if (poses && poses->body_given()) {
        seen.body.given = true;
        if (poses->fit()) seen.body.fitted_stature_m = poses->fit()->shape.stature_m;
    }
    if (quality::rig_is_inconsistent(seen.rig) && !quality::is_explained_without_time(seen.rig))
        if (const auto session = read_session(session_file_); session.ok())
            seen.rig.time = quality::measure_camera_time(*session);
    return seen;
}

quality::QualityReport QualityPass::finish(const PosePass* poses, const std::vector<PoseRow>& rows) const {
    return quality::judge(measure(poses, rows));
}

}  // namespace kinevox
