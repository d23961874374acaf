// The whole way from what the cameras saw to their offsets.
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
    double max_shift_s = 30;
    bool use_places = true;
};

struct Alignment {
    OffsetSolution solution;
    bool used_places = false;                // a calibration of the cameras' places took part
    std::vector<MovementSignals> movements;  // per camera
};

// FailedPrecondition as solve_offsets(), and where a camera never sees anybody.
absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options);

}  // namespace kinevox::sync
