// What made the results in a folder, and whether they are those that would be made again.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>

namespace kinevox {

struct ProcessOptions;

// Of all that the results depend on: the session's files (session, calibration, videos and empty scenes, by
// name, size, and what stands at their beginning and end), the T-pose's, the options and the program's
// version; 16 hexadecimal digits. The same on every machine, wherever the files lie and whenever they were
// copied. The errors of read_session().
absl::StatusOr<std::string> run_fingerprint(const ProcessOptions& options);

// run.toml, which is written last of all: where it stands, the results beside it are whole.
std::string run_toml(const ProcessOptions& options, const std::string& fingerprint, double fps,
                     std::int64_t frames);

// True where `folder` holds whole results of this fingerprint.
bool holds_results_of(const std::filesystem::path& folder, const std::string& fingerprint);

}  // namespace kinevox
