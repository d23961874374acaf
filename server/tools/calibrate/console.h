// A progress line on a terminal.
#pragma once

#include "server/calibration/finding.h"

namespace kinevox::calibrate {

// Draws on standard error if that is a terminal, at most ten times per second. Ctrl-C cancels at the next
// call. Create it before other threads start.
SolveProgress console_progress(bool quiet);

}  // namespace kinevox::calibrate
