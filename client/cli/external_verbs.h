// `kinevox VERB` starts the program kinevox-VERB, as git does: the tools that need the pipeline but no daemon
// live there, so that this client needs neither OpenCV nor the kernels.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox::cli {

// Looked for beside this executable, in ../lib/kinevox, where the build tree has it, then on PATH.
std::optional<std::filesystem::path> find_external_verb(const std::string& verb);

// Their names without "kinevox-", sorted.
std::vector<std::string> external_verbs();

// Replaces this process; arguments[0] (the verb) becomes the program's path. Returns only if that fails, with
// the reason.
std::string run_external_verb(const std::filesystem::path& program, char** arguments);

}  // namespace kinevox::cli
