// Body size from the subject: stature, segment lengths and girths fitted together with the postures of some
// frame sets.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct BodyFit {
    BodyShape shape;
    // One standard deviation of each, from the curvature at the solution with what is usual for a stature in
    // it.
    std::array<double, kBodyLengthCount> lengths_std_m{};
    double stature_std_m = 0;
    double contour_rms_m = 0;  // over all frame sets, at the solution
    int frames = 0;            // that were used
};

// Of a circumference; its two half-widths err on their own.
double girth_std_m(const BodyFit& fit, const BodyGirthInfo& girth);

// Poses of `frames` (at least one) are found by tracking them in their order with the starting shape, then
// lengths and postures are moved together, lengths held by what is usual for a stature (BodyLengthInfo).
// FailedPrecondition where no body is found in them; Cancelled soon after `stop` says so. `progress` gets the
// part done, 0..1.
absl::StatusOr<BodyFit> fit_body(const std::vector<Camera>& cameras, double fps,
                                 std::span<const PoseObservation* const> frames, const BodyShape& start,
                                 const PoseStageOptions& posing, const BodyFitOptions& options = {},
                                 std::stop_token stop = {}, const std::function<void(double)>& progress = {});

}  // namespace kinevox
