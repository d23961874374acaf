// `kinevox stream angles` and `kinevox stream joints`.
#pragma once

#include "client/cli/line_stream.h"

namespace kinevox::cli {

void add_pose_streams(CLI::App& stream, Common& common, Run& run);

}  // namespace kinevox::cli
