// A status as text for people.
#pragma once

#include <string>

#include "kinevox/v1/capture_service.pb.h"

namespace kinevox::cli {

// Several lines, no newline at the end. `status` prints it once, `watch` on a terminal again and again.
std::string status_text(const v1::GetStatusResponse& status);

// One line, for `watch` into a pipe.
std::string status_line(const v1::GetStatusResponse& status);

}  // namespace kinevox::cli
