// Body size from the subject: stature, segment lengths and girths fitted together with the postures of some frame sets.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include <absl/status/statusor.h>

#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct BodyFit {
    BodyShape shape;
    double contour_rms_m = 0;     // over all frame sets, at the solution
    int frames = 0;               // that were used
};

// Poses of `frames` (at least one) are found by tracking them in their order with the starting shape, then lengths and
// postures are moved together, lengths held by what is usual for a stature (BodyLengthInfo). FailedPrecondition where
// no body is found in them.
absl::StatusOr<BodyFit> fit_body(const std::vector<Camera>& cameras, double fps,
                                 std::span<const PoseObservation* const> frames, const BodyShape& start,
                                 const PoseStageOptions& posing, const BodyFitOptions& options = {});

}  // namespace kinevox
