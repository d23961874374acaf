#include "client/viewer/calibration_words.h"

#include <fmt/format.h>

namespace kinevox::viewer {

const std::vector<CalibrationKindWords>& calibration_kinds() {
    static const std::vector<CalibrationKindWords> kinds{
        {v1::PROCEDURE_KIND_REFINE_PERSON, "Straighten the cameras: somebody walks",
         "Somebody walks through the space, nothing else is needed. Mends small shifts of cameras that were "
         "calibrated "
         "before."},
        {v1::PROCEDURE_KIND_EXTRINSICS_BOARD, "Where the cameras stand: with a board",
         "A printed board is moved through the space. For cameras that were set up or moved; their lenses "
         "are known."},
        {v1::PROCEDURE_KIND_EXTRINSICS_WAND, "Where the cameras stand: with a wand",
         "A wand with two or three bright balls is waved through the space. For large spaces; the lenses are "
         "known."},
        {v1::PROCEDURE_KIND_INTRINSICS, "The lenses: with a board",
         "A printed board is shown to each camera. Once for each lens, and again after its zoom or focus was "
         "turned."}};
    return kinds;
}

std::string instruction(v1::ProcedureKind kind, CalibrationStep step) {
    switch (step) {
        case CalibrationStep::kNone:
            return "";
        case CalibrationStep::kStarting:
            return "One moment";
        case CalibrationStep::kEmptyScene:
            return "Leave the space empty for a moment";
        case CalibrationStep::kBoardOnFloor:
            return "Lay the board on the floor, print up, where two cameras see all of it";
        case CalibrationStep::kSolving:
            return "That was enough. Working it out";
        case CalibrationStep::kMoving:
            break;
    }
    switch (kind) {
        case v1::PROCEDURE_KIND_INTRINSICS:
            return "Show the board to each camera: near and far, tilted, and in the corners. Hold it still "
                   "each time";
        case v1::PROCEDURE_KIND_EXTRINSICS_BOARD:
            return "Move the board through the whole space, so that two cameras always see it. Hold it still "
                   "each time";
        case v1::PROCEDURE_KIND_EXTRINSICS_WAND:
            return "Wave the wand slowly through the whole space, high and low and in all directions";
        default:
            return "Walk through the whole space, at best in a circle, upright, arms a little away from the "
                   "body";
    }
}

CalibrationStep step_of(const v1::WatchProcedureResponse& progress) {
    if (progress.state() == v1::PROCEDURE_STATE_SOLVING || progress.state() == v1::PROCEDURE_STATE_READING)
        return CalibrationStep::kSolving;
    if (progress.state() != v1::PROCEDURE_STATE_COLLECTING) return CalibrationStep::kNone;
    if (!progress.live()) return CalibrationStep::kStarting;
    switch (progress.taking()) {
        case v1::LiveObservations::WHAT_EMPTY_SCENE:
            return CalibrationStep::kEmptyScene;
        case v1::LiveObservations::WHAT_BOARD_ON_FLOOR:
            return CalibrationStep::kBoardOnFloor;
        default:
            return CalibrationStep::kMoving;
    }
}

std::string verdict_word(v1::Verdict verdict) {
    switch (verdict) {
        case v1::VERDICT_GO:
            return "GO";
        case v1::VERDICT_CARE:
            return "CARE";
        case v1::VERDICT_NO_GO:
            return "NO-GO";
        default:
            return "not judged";
    }
}

std::string verdict_sentence(v1::Verdict verdict) {
    switch (verdict) {
        case v1::VERDICT_GO:
            return "This calibration is good. Use it.";
        case v1::VERDICT_CARE:
            return "It can be used; read what to mind first.";
        case v1::VERDICT_NO_GO:
            return "Do not measure with this one. Do what is said below and calibrate again.";
        default:
            return "Nobody has judged it. Compare volume and pictures before you rely on it.";
    }
}

std::string finding_line(const v1::CertificateFinding& finding) {
    const bool named =
        finding.camera().empty() || finding.reason().find(finding.camera()) != std::string::npos;
    return fmt::format("{}{}{}{}", named ? "" : "camera " + finding.camera() + ": ", finding.reason(),
                       finding.remedy().empty() ? "" : "; ", finding.remedy());
}

std::vector<std::pair<std::string, std::string>> certificate_figures(const v1::Certificate& c) {
    std::vector<std::pair<std::string, std::string>> figures;
    if (c.has_held_out_rms_px())
        figures.emplace_back("views kept apart for checking miss by",
                             fmt::format("{:.2f} pixels", c.held_out_rms_px()));
    else if (c.has_fit_rms_px())
        figures.emplace_back("the views miss by", fmt::format("{:.2f} pixels", c.fit_rms_px()));
    if (c.has_scale_bias_mm_per_m())
        figures.emplace_back("lengths are off by",
                             fmt::format("{:+.1f} mm in a metre", c.scale_bias_mm_per_m()));
    if (c.has_hull_iou())
        figures.emplace_back(
            "volume and silhouettes agree to",
            fmt::format("{:.1f} %", 100 * c.hull_iou()) +
                (c.has_hull_iou_before() ? fmt::format(", before {:.1f} %", 100 * c.hull_iou_before()) : ""));
    if (c.has_subject_height_m())
        figures.emplace_back("the person is", fmt::format("{:.2f} m tall", c.subject_height_m()));
    if (c.has_volume_seen_by_three())
        figures.emplace_back("of the space, three cameras see",
                             fmt::format("{:.0f} %", 100 * c.volume_seen_by_three()));
    figures.emplace_back("the floor", c.world_is_set() ? "is known" : "is not known");
    return figures;
}

}  // namespace kinevox::viewer
