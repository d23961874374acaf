// Calibrations of other programs to ours and back.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "common/atomic_file.h"
#include "common/calibration_file.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct Files {
    std::string in, out, format;
};

absl::Status import_calibration(const Files& files) {
    const auto cameras = read_calibration(files.in);
    if (!cameras.ok()) return cameras.status();
    if (absl::Status written = write_calibration_toml(*cameras, files.out); !written.ok()) return written;
    fmt::print("{} cameras written to {}\n", cameras->size(), files.out);
    return absl::OkStatus();
}

absl::Status export_calibration(const Files& files) {
    const auto cameras = read_calibration(files.in);
    if (!cameras.ok()) return cameras.status();
    if (files.format == "toml") return write_calibration_toml(*cameras, files.out);
    if (files.format == "opencv") return write_file_atomically(files.out, calibration_opencv_yaml(*cameras));
    if (const std::string problem = kalibr_problem(*cameras); !problem.empty())
        return absl::InvalidArgumentError(fmt::format("{}: {}", files.in, problem));
    return write_file_atomically(files.out, calibration_kalibr_yaml(*cameras));
}

}  // namespace

std::vector<Verb> file_verbs(CLI::App& app) {
    const auto in_files = std::make_shared<Files>();
    CLI::App* const import = app.add_subcommand("import", "Another program's calibration to Kinevox' TOML");
    import
        ->add_option("file", in_files->in,
                     ".toml (Pose2Sim, aniposelib), .qca.txt (Qualisys), .yml (OpenCV, Kalibr)")
        ->required();
    import->add_option("--out", in_files->out, "The TOML file to write")->required();

    const auto out_files = std::make_shared<Files>(Files{"", "", "opencv"});
    CLI::App* const export_ = app.add_subcommand("export", "A calibration in another program's format");
    export_->add_option("file", out_files->in, "Any calibration that import reads")->required();
    export_->add_option("--out", out_files->out, "The file to write")->required();
    export_->add_option("--format", out_files->format, "toml, opencv or kalibr")
        ->check(CLI::IsMember({"toml", "opencv", "kalibr"}))
        ->capture_default_str();
    return {{import, [in_files] { return import_calibration(*in_files); }},
            {export_, [out_files] { return export_calibration(*out_files); }}};
}

}  // namespace kinevox::calibrate
