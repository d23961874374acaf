// Pages that `kinevox report` draws of what a program of ours found.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

namespace kinevox {

// Draws the certificate or alignment in `json_file` as one page, `png_file`. The program kinevox-report draws
// it, which lies beside ours or in lib/kinevox; it takes some seconds. NotFound where it is not installed,
// Unavailable where it fails.
absl::Status draw_report_page(const std::filesystem::path& json_file, const std::filesystem::path& png_file);

}  // namespace kinevox
