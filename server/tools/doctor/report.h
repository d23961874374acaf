// What the checks found, in words, as JSON and as a script.
#pragma once

#include <string>

#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {

bool any_bad(const Findings& findings);
std::string to_text(const Findings& findings, bool coloured);
std::string to_json(const Findings& findings);  // one object
// A shell script that mends what root can mend, to be read before it is run.
std::string fix_script(const Findings& findings);

}  // namespace kinevox::doctor
