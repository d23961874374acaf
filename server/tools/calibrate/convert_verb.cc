// Calibration files of other programs and back.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "common/calibration_file.h"
#include "common/files.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct ConvertArguments {
    std::string in, format = "toml";
    Output output;
};

absl::Status convert(const ConvertArguments& arguments) {
    if (absl::Status free = check_output(arguments.output); !free.ok()) return free;
    const auto cameras = read_calibration(arguments.in);
    if (!cameras.ok()) return cameras.status();
    absl::Status written;
    if (arguments.format == "toml") {
        written = write_calibration_toml(*cameras, arguments.output.file);
    } else if (arguments.format == "opencv") {
        written = write_file_atomically(arguments.output.file, calibration_opencv_yaml(*cameras));
    } else {
        if (const std::string problem = kalibr_problem(*cameras); !problem.empty())
            return absl::InvalidArgumentError(fmt::format("{}: {}", arguments.in, problem));
        written = write_file_atomically(arguments.output.file, calibration_kalibr_yaml(*cameras));
    }
    if (!written.ok()) return written;
    if (arguments.output.json)
        fmt::print("{}\n",
                   nlohmann::ordered_json{{"camera_count", cameras->size()}, {"file", arguments.output.file}}
                       .dump());
    arguments.output.print("{} {} written to {}\n", cameras->size(),
                           cameras->size() == 1 ? "camera" : "cameras", arguments.output.file);
    return absl::OkStatus();
}

}  // namespace

std::vector<Verb> convert_verbs(CLI::App& app) {
    const auto arguments = std::make_shared<ConvertArguments>();
    CLI::App* const verb = app.add_subcommand("convert", "Convert a calibration file to another format");
    verb->add_option("file", arguments->in,
                     "Calibration: .toml (Pose2Sim, aniposelib), .qca.txt (Qualisys), .yml (OpenCV, Kalibr)")
        ->required();
    verb->add_option("--out", arguments->output.file, "Output file")->required();
    verb->add_flag("--overwrite", arguments->output.overwrite, "Replace an existing output file");
    verb->add_flag("--json", arguments->output.json, "Print one JSON object");
    verb->add_option("--format", arguments->format, "Output format: toml, opencv or kalibr")
        ->check(CLI::IsMember({"toml", "opencv", "kalibr"}))
        ->capture_default_str();
    return {{verb, [arguments] { return convert(*arguments); }}};
}

}  // namespace kinevox::calibrate
