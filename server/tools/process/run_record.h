// Provenance of a results folder: input, options, fingerprint.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <string>

namespace kinevox {

struct ProcessOptions;

// Of everything that determines the results: the session's files (session, calibration, videos and
// backgrounds, by name, size, first and last bytes), the T-pose's, the options and the program's version; 16
// hexadecimal digits. The same on every machine, wherever the files are. The errors of read_session().
absl::StatusOr<std::string> run_fingerprint(const ProcessOptions& options);

// run.toml, written last: if it exists, the results are complete.
std::string run_toml(const ProcessOptions& options, const std::string& fingerprint, double fps,
                     std::int64_t frames);

// True if `folder` holds complete results with this fingerprint.
bool holds_results_of(const std::filesystem::path& folder, const std::string& fingerprint);

}  // namespace kinevox
