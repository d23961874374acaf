// A calibration in plain words: what to do now, and how good the result is.
#pragma once

#include <string>
#include <vector>

#include "client/viewer/calibration_run.h"

namespace kinevox::viewer {

struct CalibrationKindWords {
    v1::ProcedureKind kind;
    const char* name;     // in a list
    const char* purpose;  // one or two sentences
};
const std::vector<CalibrationKindWords>& calibration_kinds();

// To be read from afar: what the person in the space does now.
std::string instruction(v1::ProcedureKind kind, CalibrationStep step);
// Of a procedure that somebody else began, too.
CalibrationStep step_of(const v1::WatchProcedureResponse& progress);
// "GO", and what that means for the coach.
std::string verdict_word(v1::Verdict verdict);
std::string verdict_sentence(v1::Verdict verdict);
// A finding as one line: whom it is about, why, what to do.
std::string finding_line(const v1::CertificateFinding& finding);
// Name and value of each figure that is known.
std::vector<std::pair<std::string, std::string>> certificate_figures(const v1::Certificate& certificate);

}  // namespace kinevox::viewer
