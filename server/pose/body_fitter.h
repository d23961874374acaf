// Fits stature, segment lengths and girths together with the postures of several frame sets.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/pose/pose_stage.h"

namespace kinevox {

struct BodyFit {
    BodyShape shape;
    // From the curvature at the solution, with the prior of lengths given the stature.
    std::array<double, kBodyLengthCount> lengths_std_m{};
    double stature_std_m = 0;
    double contour_residual_rms_m = 0;  // over all frame sets
    int frame_set_count = 0;            // used for the fit
    // Above 0 if the silhouettes do not show the feet and the body stands on the floor instead: for
    // PoseCostOptions.
    double standing_m = 0;
};

struct ObservedPosture {
    const PoseObservation* frame = nullptr;
    BodyPosture posture;
};

// Of a circumference; the errors of its two half-widths are independent.
double girth_std_m(const BodyFit& fit, const BodyGirthInfo& girth);

// Tracks `frames` (at least one) with the initial shape, then optimises lengths and postures together with a
// prior on the lengths given the stature (BodyLengthInfo). FailedPrecondition if no body is found; Cancelled
// soon after `stop`. `progress` receives 0..1.
absl::StatusOr<BodyFit> fit_body(const std::vector<Camera>& cameras, double fps,
                                 std::span<const PoseObservation* const> frames, const BodyShape& start,
                                 const PoseStageOptions& posing, const BodyFitOptions& options = {},
                                 std::stop_token stop = {}, const std::function<void(double)>& progress = {});

// Optimises lengths and the given postures (at least one) together, without a search: in a fraction of the
// time. `stood` as in floating_frames(). Nothing after `stop`.
std::optional<BodyFit> fit_lengths(std::span<const ObservedPosture> posed, const BodyShape& start, bool stood,
                                   const PoseStageOptions& posing, const BodyFitOptions& options = {},
                                   const std::stop_token& stop = {});

}  // namespace kinevox
