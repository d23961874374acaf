// `kinevox stream angles`, `stream joints` and `stream coordinates`.
#pragma once

#include "client/cli/line_stream.h"

namespace kinevox::cli {

void add_pose_streams(CLI::App& stream, GlobalOptions& global, Run& run);

}  // namespace kinevox::cli
