// Tracks the poses of a recording forwards and backwards, searches around the result, and takes the path
// through all postures found that explains the silhouettes with the least acceleration (pose_path.h).
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "common/camera.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct RetrackedFrame {
    std::optional<BodyPosture> posture;  // unfiltered; empty if no pose is found
    std::shared_ptr<BodyPose> pose;      // null then
    double probability = 0;              // of the posture among all considered, 0..1
};

// One entry per frame set; subject_id and sequence are copied to the results.
struct RecordedView {
    std::uint32_t subject_id = 0;
    std::uint64_t sequence = 0;
    const PoseObservation* seen = nullptr;  // null: no subject
};
// Postures around the path are searched `rounds` times. Incomplete after `stop`.
inline constexpr int kRetrackRounds = 2;
std::vector<RetrackedFrame> retrack(const std::vector<Camera>& cameras, double fps,
                                    std::span<const RecordedView> frames, const PoseStageOptions& options,
                                    int rounds = kRetrackRounds, std::stop_token stop = {});

}  // namespace kinevox
