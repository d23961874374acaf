// Calibration procedures and certificates for people.
#pragma once

#include <chrono>
#include <string>

#include "kinevox/v1/calibration_service.pb.h"

namespace kinevox::cli {

std::string verdict_text(v1::Verdict verdict);  // "NO-GO"; "-" where it was not judged
// The verdict and its findings, then a table of the cameras; no newline at the end.
std::string certificate_text(const v1::Certificate& certificate);

// A procedure's progress: a line on standard output whenever the next hint changes, at most once in two
// seconds; where standard error is a terminal, a line there that is redrawn.
class ProcedureText {
  public:
    // False when nothing reads standard output any more.
    bool print(const v1::WatchProcedureResponse& progress);

  private:
    std::string last_;
    std::chrono::steady_clock::time_point printed_{};
};

}  // namespace kinevox::cli
