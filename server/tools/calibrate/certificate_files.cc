#include "server/tools/calibrate/certificate_files.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <ctime>

#include "common/calibration_file.h"
#include "common/files.h"
#include "server/calibration/certificate/certificate.h"

namespace kinevox::calibrate {
namespace {

namespace fs = std::filesystem;

constexpr double kSamePosition_m = 1e-3;

fs::path certificate_base(const fs::path& calibration) {
    return fs::path(calibration).replace_extension(".certificate");
}

}  // namespace

void declare_output(CLI::App& command, Output& output) {
    command.add_option("--out", output.file, "Output calibration (.toml; certificate next to it)")
        ->required();
    command.add_flag("--overwrite", output.overwrite, "Replace an existing output file");
    command.add_flag("--json", output.json, "Print the certificate as JSON");
    command.add_flag("--quiet", output.quiet, "Print no progress");
}

absl::Status check_output(const Output& output, const char* extension) {
    std::error_code error;
    const std::string file = output.file + extension;
    if (output.overwrite || output.file.empty() || !fs::exists(file, error)) return absl::OkStatus();
    return absl::AlreadyExistsError(fmt::format("{}: exists; give another --out, or --overwrite", file));
}

absl::Status write_certificate(Certificate certificate, const fs::path& base, const Output& output) {
    if (certificate.create_time.empty())
        certificate.create_time = fmt::format("{:%Y-%m-%d %H:%M}", fmt::gmtime(std::time(nullptr)));
    const fs::path json = base.string() + ".json", page = base.string() + ".png";
    const std::string text = certificate_json(certificate);
    if (absl::Status written = write_file_atomically(json, text); !written.ok()) return written;
    std::error_code error;
    fs::remove(page, error);  // of an earlier certificate
    if (const absl::Status drawn = draw_report_page(json, page); !drawn.ok())
        output.print("{}\n", std::string(drawn.message()));
    if (output.json) fmt::print("{}", text);
    return absl::OkStatus();
}

absl::Status write_calibration(const Certificate& certificate, const Output& output) {
    if (absl::Status written = write_calibration_toml(certificate.cameras, output.file); !written.ok())
        return written;
    const fs::path base = certificate_base(output.file);
    if (absl::Status written = write_certificate(certificate, base, output); !written.ok()) return written;
    std::error_code error;
    const bool page = fs::exists(base.string() + ".png", error);
    output.print("{}written to {}, certificate to {}.json{}\n", certificate_text(certificate), output.file,
                 base.string(), page ? " and .png" : "");
    return absl::OkStatus();
}

std::optional<Certificate> certificate_next_to(const fs::path& calibration,
                                               const std::vector<Camera>& cameras) {
    const fs::path file = certificate_base(calibration).string() + ".json";
    const auto text = read_file(file, 64 << 20);
    if (!text.ok()) return std::nullopt;
    auto certificate = parse_certificate(*text, file.string());
    if (!certificate.ok() || certificate->cameras.size() != cameras.size()) return std::nullopt;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const Camera& stored = certificate->cameras[c];
        if (stored.name != cameras[c].name ||
            !(norm(stored.centre_in_world() - cameras[c].centre_in_world()) < kSamePosition_m))
            return std::nullopt;
    }
    return *std::move(certificate);
}

}  // namespace kinevox::calibrate
