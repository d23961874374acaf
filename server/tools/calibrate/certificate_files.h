// Calibrations and their certificates on disk.
#pragma once

#include <absl/status/status.h>
#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/calibration/certificate/certificate.h"

namespace CLI {
class App;
}

namespace kinevox::calibrate {

// Where a command writes to and what it prints.
struct Output {
    std::string file;  // calibration
    bool overwrite = false, json = false, quiet = false;

    // Text for the terminal; nothing with --json.
    template <class... Values>
    void print(fmt::format_string<Values...> format, Values&&... values) const {
        if (!json) fmt::print(format, std::forward<Values>(values)...);
    }
};

// Declares --out, --overwrite, --json and --quiet.
void declare_output(CLI::App& command, Output& output);

// AlreadyExists if the file, with `extension` added to its name, exists and may not be replaced; before the
// long work.
absl::Status check_output(const Output& output, const char* extension = "");

// Writes `base`.json and, if kinevox-report can draw it, `base`.png; prints why the page could not be drawn.
absl::Status write_certificate(Certificate certificate, const std::filesystem::path& base,
                               const Output& output);

// Writes the cameras to `output.file` and the certificate next to it, NAME.certificate.json; prints the
// verdict, or the certificate with --json.
absl::Status write_calibration(const Certificate& certificate, const Output& output);

// The certificate next to a calibration; empty if there is none, or if it is of other cameras.
std::optional<Certificate> certificate_next_to(const std::filesystem::path& calibration,
                                               const std::vector<Camera>& cameras);

}  // namespace kinevox::calibrate
