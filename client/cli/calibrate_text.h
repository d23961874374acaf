// Calibration procedures and certificates for people.
#pragma once

#include <chrono>
#include <string>

#include "kinevox/v1/calibration_service.pb.h"

namespace kinevox::cli {

std::string verdict_text(v1::Verdict verdict);  // "NO-GO"; "-" where nobody has judged
// The verdict and its findings, then a table of the cameras.
std::string certificate_text(const v1::Certificate& certificate);

bool is_open(const v1::WatchProcedureResponse& progress);

// A procedure's progress: a line on standard output whenever what to do next has changed, at most once in two
// seconds; between them, where standard error is a terminal, one line there that is drawn over and over.
class ProcedureText {
  public:
    // False when nobody reads standard output any more.
    bool print(const v1::WatchProcedureResponse& progress);

  private:
    std::string last_;
    std::chrono::steady_clock::time_point printed_{};
};

}  // namespace kinevox::cli
