// The findings as text, as JSON and as a script.
#pragma once

#include <string>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {

bool any_error(const Findings& findings);
std::string to_text(const Findings& findings, bool coloured);
std::string to_json(const Findings& findings);  // one object
// A shell script with the fixes for root, to be reviewed before it runs.
std::string fix_script(const Findings& findings);

}  // namespace kinevox::doctor
