// The poses of a recording from what its frame sets showed: followed forwards and backwards, so that a limb
// that is lost in one direction is taken from the other.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/camera.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct RetrackedFrame {
    std::optional<BodyPosture> posture;  // not filtered; nothing where no body can be told
    std::shared_ptr<BodyPose> pose;      // null then
};

// One entry a frame set; null: nobody was tracked there. `sequences` and `subjects` alike, for the results.
struct RecordedView {
    std::uint32_t subject_id = 0;
    std::uint64_t sequence = 0;
    const PoseObservation* seen = nullptr;
};
std::vector<RetrackedFrame> retrack(const std::vector<Camera>& cameras, double fps,
                                    std::span<const RecordedView> frames, const PoseStageOptions& options);

}  // namespace kinevox
