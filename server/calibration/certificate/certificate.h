// A calibration's quality and verdict, as JSON and as one page.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/board/intrinsics.h"
#include "server/calibration/coverage.h"
#include "server/calibration/finding.h"
#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {

// How the floor was defined.
struct FloorQuality {
    std::string method;                                           // "board", "points", "person"
    std::optional<double> rms_px, flatness_rms_mm, tilt_std_deg;  // see FloorResult
};

struct Certificate {
    std::string method;  // "intrinsics_board", "extrinsics_board", "extrinsics_wand", "person", "import";
                         // tools: "floor", "check"
    std::string create_time;  // UTC, "2026-03-01 14:05"; empty: unknown
    std::vector<Camera> cameras;
    std::vector<IntrinsicsResult> intrinsics;       // if solved in the same run; by name
    std::vector<CameraReprojection> reprojections;  // from a board or wand: per camera
    double fit_rms_px = 0;
    std::optional<double> held_out_rms_px;
    std::optional<ScaleError> scale;
    std::optional<VolumeCoverage> volume;
    std::vector<Vec3> target_points;  // m, world: a selection of the target points seen while calibrating
    std::optional<FloorQuality> floor;
    std::vector<SilhouetteOverlay> overlays;
    std::optional<HullIou> hull_iou, hull_iou_before;
    std::optional<double> stature_m;
    bool world_defined = false;  // z is up and the floor is z = 0
    std::vector<Finding> findings;

    Verdict verdict() const { return worst(findings); }
};

std::string certificate_json(const Certificate& certificate);
// Parses the JSON, except single views of intrinsics. InvalidArgument, one line, for anything else, and for a
// key of an earlier version, with its new name; `name_for_errors` stands for the file.
absl::StatusOr<Certificate> parse_certificate(const std::string& json, const std::string& name_for_errors);
// An even selection, for Certificate::target_points.
std::vector<Vec3> sample_points(const std::vector<Vec3>& points);
// For the terminal: the verdict, then one line per finding.
std::string certificate_text(const Certificate& certificate);

// Draws the certificate or alignment in `json_file` as one page, `png_file`, with the program kinevox-report
// from the same folder or lib/kinevox; takes some seconds. NotFound if it is not installed, Unavailable if it
// fails.
absl::Status draw_report_page(const std::filesystem::path& json_file, const std::filesystem::path& png_file);

}  // namespace kinevox
