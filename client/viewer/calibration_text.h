// Texts for calibrating: the instruction of each step, and the result's certificate.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "client/lib/guided_calibration.h"

namespace kinevox::viewer {

using client::CalibrationStep;

struct CalibrationKindText {
    v1::ProcedureKind kind;
    const char* name;     // in a list
    const char* purpose;  // one or two sentences
};
const std::vector<CalibrationKindText>& calibration_kinds();

// What the person in the space does now; short, to be read from a distance.
std::string instruction(v1::ProcedureKind kind, CalibrationStep step);
// The step of any client's procedure.
CalibrationStep step_of(const v1::WatchProcedureResponse& progress);
// "GO", and what it means.
std::string verdict_text(v1::Verdict verdict);
std::string verdict_sentence(v1::Verdict verdict);
std::string method_text(v1::CalibrationMethod method);
// A finding on one line: camera, reason, remedy.
std::string finding_line(const v1::CertificateFinding& finding);
// Name and value of each known quality measure.
std::vector<std::pair<std::string, std::string>> certificate_values(const v1::Certificate& certificate);

}  // namespace kinevox::viewer
