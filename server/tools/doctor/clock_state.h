// Whether the machine's clock is set by another.
#pragma once

#include "server/tools/doctor/finding.h"

namespace kinevox::doctor {

struct ClockState {
    bool known = false, synchronised = false;
    double error_ms = 0;  // as the kernel estimates it
};

ClockState clock_state();
Finding judge(const ClockState& clock);

}  // namespace kinevox::doctor
