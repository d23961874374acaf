#include <fmt/format.h>

#include "client/viewer/calibration.h"

namespace kinevox::viewer {

const std::vector<CalibrationKindText>& calibration_kinds() {
    static const std::vector<CalibrationKindText> kinds{
        {v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON, "Refine extrinsics (walking person)",
         "A person walks through the space; no target is needed. Corrects small camera movements since the "
         "last calibration."},
        {v1::PROCEDURE_KIND_EXTRINSICS_BOARD, "Extrinsics with a board",
         "A printed board is moved through the space. For cameras that were set up or moved; their "
         "intrinsics must be known."},
        {v1::PROCEDURE_KIND_EXTRINSICS_WAND, "Extrinsics with a wand",
         "A wand with two or three bright balls is moved through the space. For large spaces; the "
         "intrinsics must be known."},
        {v1::PROCEDURE_KIND_INTRINSICS, "Intrinsics with a board",
         "A printed board is shown to each camera. Once per camera, and again after its zoom or focus was "
         "changed."}};
    return kinds;
}

std::string instruction(v1::ProcedureKind kind, CalibrationStep step) {
    switch (step) {
        case CalibrationStep::kNone:
            return "";
        case CalibrationStep::kStarting:
            return "Starting";
        case CalibrationStep::kReadingFiles:
            return "Reading files";
        case CalibrationStep::kEmptyScene:
            return "Leave the space empty";
        case CalibrationStep::kBoardOnFloor:
            return "Lay the board on the floor, print up, in full view of two cameras";
        case CalibrationStep::kSolving:
            return "Computing the calibration";
        case CalibrationStep::kMovingTarget:
            break;
    }
    switch (kind) {
        case v1::PROCEDURE_KIND_INTRINSICS:
            return "Show the board to each camera: near and far, tilted, and in the corners. Hold it still "
                   "each time";
        case v1::PROCEDURE_KIND_EXTRINSICS_BOARD:
            return "Move the board through the whole space, always in view of two cameras. Hold it still "
                   "each time";
        case v1::PROCEDURE_KIND_EXTRINSICS_WAND:
            return "Move the wand slowly through the whole space, high and low and in all directions";
        default:
            return "Walk through the whole space, ideally in a circle, upright, arms slightly away from the "
                   "body";
    }
}

CalibrationStep step_of(const v1::WatchProcedureResponse& progress) {
    if (progress.state() == v1::PROCEDURE_STATE_SOLVING) return CalibrationStep::kSolving;
    if (progress.state() == v1::PROCEDURE_STATE_READING_FILES) return CalibrationStep::kReadingFiles;
    if (progress.state() != v1::PROCEDURE_STATE_COLLECTING) return CalibrationStep::kNone;
    if (!progress.collecting_live()) return CalibrationStep::kStarting;
    switch (progress.live_step()) {
        case v1::LiveObservations::STEP_EMPTY_SCENE:
            return CalibrationStep::kEmptyScene;
        case v1::LiveObservations::STEP_BOARD_ON_FLOOR:
            return CalibrationStep::kBoardOnFloor;
        default:
            return CalibrationStep::kMovingTarget;
    }
}

std::string verdict_text(v1::Verdict verdict) {
    return client::verdict_text(verdict, "not checked");
}

std::string verdict_sentence(v1::Verdict verdict) {
    switch (verdict) {
        case v1::VERDICT_GO:
            return "This calibration is good and can be applied.";
        case v1::VERDICT_CAUTION:
            return "This calibration can be applied; read the findings first.";
        case v1::VERDICT_NO_GO:
            return "Do not measure with this calibration. Follow the remedies below and calibrate again.";
        default:
            return "This calibration was not checked. Compare volume and images before relying on it.";
    }
}

std::vector<std::pair<std::string, std::string>> certificate_values(const v1::Certificate& c) {
    std::vector<std::pair<std::string, std::string>> values;
    if (c.has_held_out_reprojection_rms_px())
        values.emplace_back("held-out reprojection error",
                            fmt::format("{:.2f} px", c.held_out_reprojection_rms_px()));
    else if (c.has_fit_reprojection_rms_px())
        values.emplace_back("reprojection error", fmt::format("{:.2f} px", c.fit_reprojection_rms_px()));
    if (c.has_scale_bias_mm_per_m())
        values.emplace_back("scale error", fmt::format("{:+.1f} mm per metre", c.scale_bias_mm_per_m()));
    if (c.has_hull_iou())
        values.emplace_back(
            "hull IoU",
            fmt::format("{:.3f}", c.hull_iou()) +
                (c.has_hull_iou_before() ? fmt::format(", before {:.3f}", c.hull_iou_before()) : ""));
    if (c.has_stature_m()) values.emplace_back("stature", fmt::format("{:.2f} m", c.stature_m()));
    if (c.has_three_view_volume_fraction())
        values.emplace_back("volume seen by three cameras",
                            fmt::format("{:.0f} %", 100 * c.three_view_volume_fraction()));
    values.emplace_back("world frame", c.world_defined() ? "defined" : "not defined");
    return values;
}

}  // namespace kinevox::viewer
