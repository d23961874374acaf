// `kinevox COMMAND` starts the program kinevox-COMMAND, as git does: the tools that need the pipeline but no
// daemon are programs of their own, so that this client needs neither OpenCV nor the kernels.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace kinevox::cli {

// Searched for next to this executable, in ../lib/kinevox, where the build tree has it, then on PATH.
std::optional<std::filesystem::path> find_external_verb(const std::string& verb);

// Their names without "kinevox-", sorted.
std::vector<std::string> external_verbs();

// Replaces this process. Returns only if that fails, with the reason.
std::string run_external_verb(const std::filesystem::path& program, std::vector<std::string> arguments);

}  // namespace kinevox::cli
