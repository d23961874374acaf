// `kinevox calibrate`: the commands with a daemon, and which ones work on files.
#pragma once

#include <string>

#include "client/cli/verbs.h"

namespace kinevox::cli {

// The commands of the program kinevox-calibrate, which works on files: intrinsics, extrinsics, floor, ...
bool is_calibrate_file_command(const std::string& name);

void add_start_verb(CLI::App& calibrate, GlobalOptions& global, Run& run);  // the guided procedure

}  // namespace kinevox::cli
