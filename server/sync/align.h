// From each camera's motion to the cameras' offsets.
#pragma once

#include <absl/status/statusor.h>

#include <span>
#include <string>
#include <vector>

#include "server/sync/camera_motion.h"
#include "server/sync/offsets.h"
#include "server/sync/signals.h"

namespace kinevox::sync {

struct AlignOptions {
    double max_offset_s = 30;
    bool use_extrinsics = true;
};

struct Alignment {
    OffsetSolution solution;
    bool used_extrinsics = false;            // extrinsics were used
    std::vector<MovementSignals> movements;  // per camera
};

// FailedPrecondition as solve_offsets(), and if a camera never sees a person.
absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options);

}  // namespace kinevox::sync
