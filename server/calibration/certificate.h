// What is known about a calibration's quality, and the verdict: as JSON and as one page of pictures.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

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

// One camera's silhouette at one moment, and the hull of all silhouettes as that camera sees it.
struct AgreementPicture {
    std::string camera;
    std::string
        png;  // a small picture: white where both are, orange the silhouette alone, blue the hull alone
};

// How the floor was found.
struct FloorQuality {
    std::string made_by;                                      // "board", "points", "person"
    std::optional<double> rms_px, flat_rms_mm, tilt_std_deg;  // see FloorResult
};

struct Certificate {
    std::string made_by;  // "board", "wand", "person", "check"
    std::string made_at;  // UTC, "2026-03-01 14:05"; empty: not told
    std::vector<Camera> cameras;
    std::vector<IntrinsicsResult> lenses;  // where they were solved with it; by name
    std::vector<CameraQuality> quality;    // where a board or wand was shown: per camera
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    std::optional<ScaleError> scale;
    std::optional<VolumeCoverage> volume;
    std::vector<Vec3> seen_points;  // m, world: some of what was shown while calibrating
    std::optional<FloorQuality> floor;
    std::vector<AgreementPicture> pictures;
    std::optional<HullAgreement> hull, hull_before;
    std::optional<double> subject_height_m;
    bool world_is_set = false;  // z is up and the floor is z = 0
    std::vector<Finding> findings;

    Verdict verdict() const { return worst(findings); }
};

std::string certificate_json(const Certificate& certificate);
// Back from JSON, but for the single views of lenses. InvalidArgument, one line, for what is no certificate;
// `name_for_errors` stands for the file.
absl::StatusOr<Certificate> parse_certificate(const std::string& json, const std::string& name_for_errors);
// Evenly some of many points, for Certificate::seen_points.
std::vector<Vec3> some_points(const std::vector<Vec3>& points);
// For the terminal: the verdict, then a line for each finding.
std::string certificate_text(const Certificate& certificate);

}  // namespace kinevox
