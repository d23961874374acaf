// Tracks the poses of a recording forwards and backwards and combines both, so that a limb lost in one
// direction is taken from the other.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/camera.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct RetrackedFrame {
    std::optional<BodyPosture> posture;  // unfiltered; empty if no pose is found
    std::shared_ptr<BodyPose> pose;      // null then
};

// One entry per frame set; subject_id and sequence are copied to the results.
struct RecordedView {
    std::uint32_t subject_id = 0;
    std::uint64_t sequence = 0;
    const PoseObservation* seen = nullptr;  // null: no subject
};
std::vector<RetrackedFrame> retrack(const std::vector<Camera>& cameras, double fps,
                                    std::span<const RecordedView> frames, const PoseStageOptions& options);

}  // namespace kinevox
