// `kinevox calibrate`: which of its verbs need a daemon, and those that do.
#pragma once

#include <string>
#include <vector>

#include "client/cli/verbs.h"

namespace kinevox::cli {

// Whether these arguments, behind `kinevox calibrate`, are for a daemon; else they are for the program
// kinevox-calibrate, which works on files: so are import with --out, and export of anything but an id.
bool wants_a_daemon(const std::vector<std::string>& arguments);

void add_calibrate_verb(CLI::App& app, Common& common, Run& run);
void add_start_verb(CLI::App& calibrate, Common& common, Run& run);  // the guided procedure

}  // namespace kinevox::cli
