#include "server/tools/calibrate/certificate_files.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <cstdio>
#include <ctime>

#include "common/atomic_file.h"
#include "common/calibration_file.h"
#include "server/calibration/report_page.h"

namespace kinevox::calibrate {
namespace {

namespace fs = std::filesystem;

constexpr double kSamePlace_m = 1e-3;

fs::path certificate_base(const fs::path& calibration) {
    return fs::path(calibration).replace_extension(".certificate");
}

}  // namespace

absl::Status write_certificate(Certificate certificate, const fs::path& base) {
    if (certificate.made_at.empty())
        certificate.made_at = fmt::format("{:%Y-%m-%d %H:%M}", fmt::gmtime(std::time(nullptr)));
    const fs::path json = base.string() + ".json", page = base.string() + ".png";
    if (absl::Status written = write_file_atomically(json, certificate_json(certificate)); !written.ok())
        return written;
    std::error_code error;
    fs::remove(page, error);  // of a former certificate
    if (const absl::Status drawn = draw_report_page(json, page); !drawn.ok())
        fmt::print("{}\n", std::string(drawn.message()));
    return absl::OkStatus();
}

absl::Status write_calibration(const Certificate& certificate, const fs::path& out) {
    if (absl::Status written = write_calibration_toml(certificate.cameras, out); !written.ok())
        return written;
    const fs::path base = certificate_base(out);
    if (absl::Status written = write_certificate(certificate, base); !written.ok()) return written;
    std::error_code error;
    const bool page = fs::exists(base.string() + ".png", error);
    fmt::print("{}written to {}, its certificate to {}.json{}\n", certificate_text(certificate), out.string(),
               base.string(), page ? " and .png" : "");
    return absl::OkStatus();
}

std::optional<Certificate> certificate_beside(const fs::path& calibration,
                                              const std::vector<Camera>& cameras) {
    const fs::path file = certificate_base(calibration).string() + ".json";
    const auto text = read_file(file, 64 << 20);
    if (!text.ok()) return std::nullopt;
    auto certificate = parse_certificate(*text, file.string());
    if (!certificate.ok() || certificate->cameras.size() != cameras.size()) return std::nullopt;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Camera& told = certificate->cameras[c];
        if (told.name != cameras[c].name ||
            !(norm(told.centre_in_world() - cameras[c].centre_in_world()) < kSamePlace_m))
            return std::nullopt;
    }
    return *std::move(certificate);
}

}  // namespace kinevox::calibrate
