#include "server/tools/calibrate/certificate_files.h"

#include <fmt/format.h>

#include "common/atomic_file.h"
#include "common/calibration_file.h"

namespace kinevox::calibrate {

absl::Status write_certificate(const Certificate& certificate, const std::filesystem::path& base) {
    return write_file_atomically(base.string() + ".json", certificate_json(certificate));
}

absl::Status write_calibration(const Certificate& certificate, const std::filesystem::path& out) {
    if (absl::Status written = write_calibration_toml(certificate.cameras, out); !written.ok())
        return written;
    const auto base = std::filesystem::path(out).replace_extension(".certificate");
    if (absl::Status written = write_certificate(certificate, base); !written.ok()) return written;
    fmt::print("{}written to {}, certificate beside it\n", certificate_text(certificate), out.string());
    return absl::OkStatus();
}

}  // namespace kinevox::calibrate
