// What ExtrinsicsProcedure measures and judges after, and before, its solve.
#pragma once

#include <optional>
#include <vector>

#include "server/calibration/extrinsics.h"
#include "server/calibration/posed_views.h"

namespace kinevox {

// What the views alone tell: a mirrored print.
std::vector<Finding> check_views(const PosedViews& views);

// Distances between neighbouring board points, triangulated from the cameras alone, against the print.
std::optional<ScaleError> scale_error(const Bundle& bundle);

std::vector<CameraQuality> camera_quality(const Bundle& fit, const BundleReport& fit_report,
                                          const Bundle& held_out, const BundleReport& held_report);

enum class Shown { kBoard, kWand };

// Findings of the solved bundle: errors, and where they are large what explains them (two cameras swapped,
// one that moved meanwhile), too few views, poor coverage, always the same tilt.
void append_findings(const Bundle& bundle, Shown shown, ExtrinsicsResult& result);

}  // namespace kinevox
