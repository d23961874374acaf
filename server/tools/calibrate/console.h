// One line of progress on a terminal.
#pragma once

#include "server/calibration/finding.h"

namespace kinevox::calibrate {

// Draws on standard error if that is a terminal, at most ten times a second. Ctrl-C cancels at the next call;
// to be made before other threads start.
SolveProgress console_progress(bool quiet);

}  // namespace kinevox::calibrate
