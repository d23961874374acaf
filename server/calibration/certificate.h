// What is known about a calibration's quality, and the verdict: as JSON and as one page of pictures.
#pragma once

#include <absl/status/status.h>

#include <optional>
#include <string>
#include <vector>

#include "server/calibration/extrinsics.h"
#include "server/calibration/finding.h"
#include "server/calibration/intrinsics.h"
#include "server/calibration/volume_coverage.h"

namespace kinevox {

// Per camera, how far its silhouettes and the hull's own projections agree.
struct HullAgreement {
    std::vector<double> iou;  // per camera, mean over frames, 0 to 1; NaN: never compared
    double mean_iou = 0;      // over frames and cameras
    int frames = 0;
};

struct Certificate {
    std::string made_by;  // "board", "wand", "person", "check"
    std::vector<Camera> cameras;
    std::vector<IntrinsicsResult> lenses;  // where they were solved with it; by name
    std::vector<CameraQuality> quality;    // where a board or wand was shown: per camera
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    std::optional<ScaleError> scale;
    std::optional<VolumeCoverage> volume;
    std::optional<HullAgreement> hull, hull_before;
    std::optional<double> subject_height_m;
    bool world_is_set = false;  // z is up and the floor is z = 0
    std::vector<Finding> findings;

    Verdict verdict() const { return worst(findings); }
};

std::string certificate_json(const Certificate& certificate);
// For the terminal: the verdict, then a line for each finding.
std::string certificate_text(const Certificate& certificate);

}  // namespace kinevox
