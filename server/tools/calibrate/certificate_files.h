// A calibration and its certificate on disk.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

#include "server/calibration/certificate.h"

namespace kinevox::calibrate {

// Writes OUT.toml and beside it OUT.certificate.json and OUT.certificate.png, and prints the verdict.
absl::Status write_calibration(const Certificate& certificate, const std::filesystem::path& out);
// The certificate alone; `base` with ".json" and ".png" added.
absl::Status write_certificate(const Certificate& certificate, const std::filesystem::path& base);

}  // namespace kinevox::calibrate
