// Pages that `kinevox report` draws.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

namespace kinevox {

// Draws the certificate or alignment in `json_file` as one page, `png_file`, with the program kinevox-report
// from the same folder or lib/kinevox; takes some seconds. NotFound if it is not installed, Unavailable if it
// fails.
absl::Status draw_report_page(const std::filesystem::path& json_file, const std::filesystem::path& png_file);

}  // namespace kinevox
