// Calibrations and their certificates on disk.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <optional>
#include <vector>

#include "server/calibration/certificate.h"

namespace kinevox::calibrate {

// `base`.json and, where kinevox-report can draw it, `base`.png; a page that cannot be drawn is told, no
// error.
absl::Status write_certificate(Certificate certificate, const std::filesystem::path& base);

// The cameras to `out` and the certificate beside it, NAME.certificate.json; tells the verdict on standard
// output.
absl::Status write_calibration(const Certificate& certificate, const std::filesystem::path& out);

// The certificate beside a calibration; nothing where there is none, or where it is of other cameras.
std::optional<Certificate> certificate_beside(const std::filesystem::path& calibration,
                                              const std::vector<Camera>& cameras);

}  // namespace kinevox::calibrate
