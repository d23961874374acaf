// kinevox-export: a trial or recording in the format of another program.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "common/command_line.h"
#include "common/export_options.h"
#include "common/geometry.h"
#include "common/progress_line.h"
#include "server/cameras/session_source.h"
#include "server/recording/recording_export.h"
#include "server/tools/console.h"

namespace {

namespace fs = std::filesystem;

struct Arguments {
    fs::path path, out;
    std::string format, range, camera;
    double yaw_deg = 0;
    int width_px = 0;
    std::uint32_t subject_id = 0;
    bool each_subject = false, hold_withheld = false, anonymous = false, overwrite = false, json = false,
         quiet = false;
};

std::string format_help() {
    std::string text = "Format: ";
    for (const kinevox::ExportFormatInfo& info : kinevox::kExportFormats)
        text += fmt::format("{}{} ({})", &info == kinevox::kExportFormats.data() ? "" : ", ", info.name,
                            info.what);
    return text + "; default with --anonymous: session";
}

std::vector<std::string> format_names() {
    std::vector<std::string> names;
    for (const kinevox::ExportFormatInfo& info : kinevox::kExportFormats) names.emplace_back(info.name);
    return names;
}

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("PATH", arguments.path, "Results folder, recording folder or session.toml")->required();
    app.add_option("--format", arguments.format, format_help())->check(CLI::IsMember(format_names()));
    app.add_option("--out", arguments.out, "Output file (ply, session: folder); required");
    app.add_option("--range", arguments.range, "Frames to export, FIRST-LAST (inclusive)");
    app.add_option("--subject", arguments.subject_id,
                   "Subject to export (id; default: the only one; ply, mp4: all)");
    app.add_flag("--each-subject", arguments.each_subject,
                 "Write a file per subject, named by id and name, into the folder --out");
    app.add_flag("--anonymous", arguments.anonymous,
                 "Remove images, colours, names and dates; show silhouettes instead");
    app.add_option("--yaw", arguments.yaw_deg,
                   "Rotation about the vertical (deg, counter-clockwise from above); OpenSim models face +x")
        ->check(CLI::Range(-360.0, 360.0));
    app.add_flag("--hold-withheld", arguments.hold_withheld,
                 "BVH: repeat the last value where one is withheld");
    app.add_option("--camera", arguments.camera, "MP4: camera to show (default: all, tiled)");
    app.add_option("--video-width", arguments.width_px, "MP4: video width (px; default: up to 1280)")
        ->check(CLI::Range(0, 8192));
    app.add_flag("--overwrite", arguments.overwrite, "Replace existing output");
    app.add_flag("--json", arguments.json, "Print one JSON object");
    app.add_flag("--quiet", arguments.quiet, "Print errors only");
}

// Written to a hidden folder next to `out` and moved when complete.
absl::StatusOr<kinevox::ExportedFiles> export_folder(const fs::path& from,
                                                     const kinevox::ExportOptions& options,
                                                     const Arguments& arguments,
                                                     const kinevox::JobControl& work) {
    const fs::path& out = arguments.out;
    std::error_code error;
    const fs::path partial =
        fs::absolute(out, error).parent_path() / fmt::format(".{}.{}", out.filename().string(), getpid());
    fs::create_directories(partial, error);
    const auto failed = [&] {
        return absl::UnavailableError(
            fmt::format("{}: cannot be created: {}", out.string(), error.message()));
    };
    if (error) return failed();
    auto written = arguments.each_subject ? kinevox::export_each_subject(from, options, partial, work)
                                          : kinevox::export_recording(from, options, partial, work);
    if (written.ok() && arguments.each_subject) {  // next to other files of the folder
        fs::create_directories(out, error);
        for (const fs::path& file : written->files)
            if (!error) fs::rename(file, out / file.filename(), error);
    } else if (written.ok()) {
        fs::remove_all(out, error);  // run() has checked --overwrite
        fs::rename(partial, out, error);
    }
    if (error) written = failed();
    fs::remove_all(partial, error);
    return written;
}

absl::StatusOr<kinevox::ExportedFiles> export_files(const Arguments& arguments,
                                                    const kinevox::ExportOptions& options,
                                                    const std::atomic<bool>& stop) {
    kinevox::ProgressLine line(arguments.quiet || arguments.json);
    const kinevox::JobControl work{stop, [&line](double progress) { line.show(progress); }};
    if (arguments.each_subject || options.format == kinevox::ExportFormat::kSession)
        return export_folder(arguments.path, options, arguments, work);
    return kinevox::export_recording(arguments.path, options, arguments.out, work);
}

absl::Status run(Arguments arguments) {
    if (arguments.format.empty() && !arguments.anonymous)
        return absl::InvalidArgumentError("--format is required; see kinevox export --help");
    if (arguments.format.empty()) arguments.format = "session";
    if (arguments.out.empty())
        return absl::InvalidArgumentError("--out is required; see kinevox export --help");
    if (arguments.out.filename().empty())
        return absl::InvalidArgumentError("--out is a folder; give a file name");
    kinevox::ExportOptions options;
    options.format = kinevox::find_export_format(arguments.format)->format;
    options.subject_id = arguments.subject_id;
    options.yaw_rad = kinevox::radians(arguments.yaw_deg);
    options.hold_withheld = arguments.hold_withheld;
    options.camera = arguments.camera;
    options.width_px = arguments.width_px;
    options.anonymous = arguments.anonymous;
    if (!arguments.range.empty()) {
        const auto range = kinevox::parse_frame_range(arguments.range);
        if (!range)
            return absl::InvalidArgumentError(
                fmt::format("--range is '{}'; expected FIRST-LAST, for example 30-89", arguments.range));
        options.first_frame = range->first;
        options.last_frame = range->last;
    }
    std::error_code ignored;
    const bool is_folder = fs::is_directory(arguments.out, ignored);
    const bool exists =
        is_folder ? !fs::is_empty(arguments.out, ignored) : fs::is_regular_file(arguments.out, ignored);
    if (exists && !arguments.overwrite)
        return absl::AlreadyExistsError(
            fmt::format("{} exists; give another --out, or --overwrite", arguments.out.string()));
    std::atomic<bool> stop{false};
    const kinevox::Interrupt interrupt([&stop] { stop = true; });
    const auto written = export_files(arguments, options, stop);
    if (!written.ok()) {
        if (options.format == kinevox::ExportFormat::kMp4)
            fs::remove(arguments.out, ignored);  // an incomplete video
        return written.status();
    }
    if (arguments.json)
        fmt::print("{}\n", nlohmann::ordered_json({{"frame_count", written->frames},
                                                   {"rate_hz", written->rate_hz},
                                                   {"out", arguments.out.string()},
                                                   {"warning", written->warning}})
                               .dump());
    else if (!arguments.quiet)
        fmt::print("{} frame{}{} in {}{}\n", written->frames, written->frames == 1 ? "" : "s",
                   written->rate_hz > 0 ? fmt::format(" at {:g} Hz", written->rate_hz) : "",
                   arguments.out.string(), written->warning.empty() ? "" : "; " + written->warning);
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    kinevox::silence_video_libraries();
    CLI::App app("Export a trial or recording to TRC, MOT, C3D, BVH, CSV, PLY or MP4", "kinevox export");
    Arguments arguments;
    declare(app, arguments);
    return kinevox::tool_main(app, argc, argv, [&arguments] { return run(arguments); });
}
