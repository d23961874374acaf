// `kinevox record export`: a recording on the server, exported there and received here.
#pragma once

#include "client/cli/verbs.h"

namespace kinevox::cli {

void add_record_export_verb(CLI::App& record, GlobalOptions& global, Run& run);

}  // namespace kinevox::cli
