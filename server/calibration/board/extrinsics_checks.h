// Checks of ExtrinsicsProcedure before and after its solve.
#pragma once

#include <optional>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/board/posed_views.h"

namespace kinevox {

// Checks that need only the views: a mirrored print.
std::vector<Finding> check_views(const PosedViews& views);

// Distances between triangulated board points against the print.
std::optional<ScaleError> scale_error(const Bundle& bundle);

std::vector<CameraReprojection> camera_reprojections(const Bundle& fit, const BundleReport& fit_report,
                                                     const Bundle& held_out, const BundleReport& held_report);

enum class TargetKind { kBoard, kWand };

// Findings of the solved bundle: large errors and their cause (two cameras swapped, a camera moved
// meanwhile), too few views, poor coverage, uniform tilt.
void append_findings(const Bundle& bundle, TargetKind kind, ExtrinsicsResult& result);

}  // namespace kinevox
