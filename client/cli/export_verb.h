// `kinevox export` of a daemon's recording; that of files is a program of its own.
#pragma once

#include <string>
#include <vector>

namespace kinevox::cli {

// Whether the words behind `kinevox export` ask for a daemon's recording: --session is among them.
bool exports_recording(const std::vector<std::string>& arguments);

}  // namespace kinevox::cli
