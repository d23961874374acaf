// kinevox-export: a processed trial in the format of another program.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "common/degrees.h"
#include "common/progress_line.h"
#include "server/cameras/session_source.h"
#include "server/recording/recording_export.h"
#include "server/tools/interrupt.h"

namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::filesystem::path folder, out;
    std::string format, frames, camera;
    double turn_deg = 0;
    int width_px = 0;
    bool hold = false, anonymous = false, quiet = false;
};

int fail(std::string message) {
    message = message.substr(0, message.find('\n'));
    fmt::print(stderr, "kinevox export: {}\n", message);
    return 1;
}

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("folder", arguments.folder,
                   "What `kinevox process` wrote, or a recording's folder or session.toml")
        ->required();
    app.add_option(
           "--format", arguments.format,
           "trc, mot (OpenSim), c3d, bvh, csv, ply (a recording's volumes, into a folder) or "
           "mp4 (pictures with the skeleton); session: a folder to pass on, with --anonymous, where it is "
           "the default")
        ->check(CLI::IsMember(std::vector<std::string>(std::begin(kinevox::kExportFormats),
                                                       std::end(kinevox::kExportFormats))));
    app.add_flag("--anonymous", arguments.anonymous,
                 "Nothing by which the person can be seen or named: silhouettes for pictures, no colours, no "
                 "names, no date");
    app.add_option("--out", arguments.out, "The file to write; of ply and session the folder; required");
    app.add_option("--frames", arguments.frames, "A part of the trial, FIRST-LAST, both included");
    app.add_option("--turn", arguments.turn_deg,
                   "Turns the trial about the vertical, degrees, anticlockwise from above: OpenSim's models "
                   "look along x")
        ->check(CLI::Range(-360.0, 360.0));
    app.add_flag("--hold", arguments.hold, "bvh: where a value is withheld, repeat the last measured one");
    app.add_option("--camera", arguments.camera, "mp4: this camera's pictures; else all of them in tiles");
    app.add_option("--width", arguments.width_px, "mp4: of the film, px; 0: 1280 at most")
        ->check(CLI::Range(0, 8192));
    app.add_flag("--quiet", arguments.quiet, "Say nothing when all is well");
}

// "FIRST-LAST".
bool parse_frames(const std::string& text, std::int64_t& first, std::int64_t& last) {
    char rest = 0;
    long long a = 0, b = 0;
    if (std::sscanf(text.c_str(), "%15lld-%15lld%c", &a, &b, &rest) != 2 || a < 0 || b < a) return false;
    first = a, last = b;
    return true;
}

// Written beside and renamed when it is whole.
absl::StatusOr<kinevox::ExportedFiles> export_session(const fs::path& from,
                                                      const kinevox::ExportOptions& options,
                                                      const fs::path& out, const kinevox::LongWork& work) {
    std::error_code error;
    if (fs::exists(out, error))
        return absl::AlreadyExistsError(
            fmt::format("{}: is there already; give another --out, or remove it", out.string()));
    const fs::path aside =
        fs::absolute(out, error).parent_path() / fmt::format(".{}.{}", out.filename().string(), getpid());
    fs::create_directories(aside, error);
    if (error)
        return absl::UnavailableError(fmt::format("{}: cannot be made: {}", out.string(), error.message()));
    auto written = kinevox::export_recording(from, options, aside, work);
    if (written.ok()) fs::rename(aside, out, error);
    if (error)
        written =
            absl::UnavailableError(fmt::format("{}: cannot be made: {}", out.string(), error.message()));
    fs::remove_all(aside, error);
    return written;
}

absl::StatusOr<kinevox::ExportedFiles> export_files(const Arguments& arguments,
                                                    const kinevox::ExportOptions& options,
                                                    const std::atomic<bool>& stop) {
    kinevox::ProgressLine line(arguments.quiet);
    const kinevox::LongWork work{stop, [&line](double share) { line.show(share); }};
    if (arguments.format == "session") return export_session(arguments.folder, options, arguments.out, work);
    return kinevox::export_recording(arguments.folder, options, arguments.out, work);
}

int run(int argc, char** argv) {
    CLI::App app(
        "Writes a processed trial or a recording as TRC or MOT (OpenSim), C3D, BVH, CSV, PLY or MP4, or as a "
        "folder without pictures. With --session NAME: "
        "a recording of a running daemon (`kinevox export --session NAME --help`).",
        "kinevox export");
    Arguments arguments;
    declare(app, arguments);
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        return fail(std::string(error.what()) + "; see kinevox export --help");
    }
    if (arguments.format.empty() && !arguments.anonymous)
        return fail("--format is required; see kinevox export --help");
    if (arguments.format.empty()) arguments.format = "session";
    if (arguments.out.filename().empty()) return fail("--out is no file's name; give the file to write");
    kinevox::ExportOptions options;
    options.format = arguments.format;
    options.turn_rad = kinevox::radians(arguments.turn_deg);
    options.hold = arguments.hold;
    options.camera = arguments.camera;
    options.width_px = arguments.width_px;
    options.anonymous = arguments.anonymous;
    if (!arguments.frames.empty() && !parse_frames(arguments.frames, options.first_frame, options.last_frame))
        return fail(
            fmt::format("--frames is '{}'; write it as FIRST-LAST, for example 30-89", arguments.frames));
    std::atomic<bool> stop{false};
    const kinevox::Interrupt interrupt([&stop] { stop = true; });
    const auto written = export_files(arguments, options, stop);
    if (!written.ok()) {
        if (arguments.format == "mp4") std::remove(arguments.out.c_str());  // half a film
        return fail(std::string(written.status().message()));
    }
    if (!arguments.quiet)
        fmt::print("{} frames{} in {}{}\n", written->frames,
                   written->rate_hz > 0 ? fmt::format(" at {:g} Hz", written->rate_hz) : "",
                   arguments.out.string(), written->remark.empty() ? "" : "; " + written->remark);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    kinevox::silence_video_libraries();
    try {
        return run(argc, argv);
    } catch (const std::exception& error) {
        return fail(error.what());
    }
}
