#include "server/tools/process/pose_pass.h"

#include <utility>

#include "server/pose/pose_stage.h"

namespace kinevox {

void PosePass::add(const FrameResult& result, const PoseStage& stage) {
    Frame frame;
    frame.row.frame = result.sequence;
    frame.row.time_s = 1e-9 * static_cast<double>(result.capture_time_ns);
    frame.row.pose = result.pose;
    if (result.pose && stage.tracked()) frame.posture = stage.tracked()->fit.posture;
    frames_.push_back(std::move(frame));
}

std::vector<PoseRow> PosePass::finish(const PoseStage& stage) {
    std::vector<std::optional<BodyPosture>> postures;
    for (const Frame& frame : frames_) postures.push_back(frame.posture);
    if (options_.cutoff_hz > 0) smooth_zero_phase(postures, fps_, options_.cutoff_hz);
    const BodyModel model(stage.body());
    std::vector<PoseRow> rows;
    for (std::size_t n = 0; n < frames_.size(); ++n) {
        PoseRow row = frames_[n].row;
        if (postures[n] && row.pose) {
            auto pose = std::make_shared<BodyPose>(*row.pose);
            describe_posture(model, *postures[n], *pose);
            pose->filtered = options_.cutoff_hz > 0;
            if (n > 0 && rows.back().pose) set_velocities(*rows.back().pose, *pose);
            row.pose = std::move(pose);
        }
        rows.push_back(std::move(row));
    }
    return rows;
}

}  // namespace kinevox
