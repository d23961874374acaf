// kinevox-sync: videos of one movement that were not started together, aligned by the silhouettes' motion.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "common/atomic_file.h"
#include "common/session_file.h"
#include "common/session_offsets.h"
#include "server/calibration/report_page.h"
#include "server/cameras/session_source.h"
#include "server/sync/align.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/sync/alignment_text.h"

namespace {

namespace fs = std::filesystem;
using namespace kinevox;

struct Arguments {
    fs::path session_file, plot;
    sync::AlignOptions align;
    bool dry_run = false, no_plot = false, no_places = false, json = false, quiet = false;
};

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option(
           "session", arguments.session_file,
           "The session's file, session.toml: a video, a background and a calibrated lens for each camera")
        ->required();
    app.add_option("--max-shift", arguments.align.max_shift_s, "Two cameras began at most so far apart, s")
        ->check(CLI::Range(0.1, 3600.0))
        ->capture_default_str();
    app.add_flag(
        "--no-places", arguments.no_places,
        "Do without the cameras' places in the calibration; for a calibration of the lenses alone this goes "
        "by itself");
    app.add_flag("--dry-run", arguments.dry_run, "Tell the offsets, but leave session.toml as it is");
    app.add_option("--plot", arguments.plot,
                   "The page of evidence and aligned movement, .png; without it sync.png beside the session");
    app.add_flag("--no-plot", arguments.no_plot, "No such page");
    app.add_flag("--json", arguments.json, "One JSON object instead of a table");
    app.add_flag("--quiet", arguments.quiet, "No progress");
}

// Through a file of its own, since the page is drawn by another program.
absl::Status draw_page(const Session& session, const sync::Alignment& alignment, const fs::path& plot) {
    std::error_code error;
    const fs::path json = fs::temp_directory_path(error) / fmt::format("kinevox-sync-{}.json", getpid());
    if (error) return absl::UnavailableError("there is no folder for temporary files; set TMPDIR");
    absl::Status status = write_file_atomically(json, sync::page_json_of(session, alignment).dump());
    if (status.ok()) status = draw_report_page(json, plot);
    if (status.code() == absl::StatusCode::kUnavailable)
        status = absl::UnavailableError(
            fmt::format("{} could not be drawn; is its folder writable, and is python3-matplotlib "
                        "installed?",
                        plot.string()));
    fs::remove(json, error);
    return status;
}

absl::Status run(const Arguments& arguments) {
    const auto session = read_session(arguments.session_file);
    if (!session.ok()) return session.status();
    if (session->recording)
        return absl::FailedPreconditionError(
            fmt::format("{}: was recorded by kinevoxd, which joined its cameras by their clocks; there is "
                        "nothing to align",
                        arguments.session_file.string()));
    const auto motion = sync::read_motion(*session, {}, calibrate::console_progress(arguments.quiet));
    if (!motion.ok()) return motion.status();
    const auto alignment = sync::align(*motion, session->fps, arguments.align);
    if (!alignment.ok()) return alignment.status();

    // The page first: it is worth less than the offsets, but nothing is to be half done where it fails.
    const fs::path plot =
        arguments.plot.empty() ? arguments.session_file.parent_path() / "sync.png" : arguments.plot;
    bool drawn = false;
    if (!arguments.no_plot) {
        const absl::Status status = draw_page(*session, *alignment, plot);
        drawn = status.ok();
        if (!drawn) fmt::print(stderr, "kinevox sync: no page: {}\n", std::string(status.message()));
    }
    if (!arguments.dry_run) {
        std::vector<double> offsets;
        for (const sync::CameraFit& camera : alignment->solution.cameras) offsets.push_back(camera.offset_s);
        if (absl::Status written = write_offsets(arguments.session_file, offsets); !written.ok())
            return written;
    }
    if (arguments.json) {
        auto json = sync::json_of(*session, *alignment);
        json["written"] = !arguments.dry_run;
        json["plot"] = drawn ? nlohmann::ordered_json(plot.string()) : nlohmann::ordered_json(nullptr);
        fmt::print("{}\n", json.dump());
        return absl::OkStatus();
    }
    fmt::print("{}", sync::table_of(*session, *alignment));
    fmt::print("{}\n", alignment->used_places
                           ? "by the silhouettes' motion and the cameras' places"
                           : "by the silhouettes' motion alone, without the cameras' places");
    if (drawn) fmt::print("plot in {}\n", plot.string());
    fmt::print("{} {}\n", arguments.dry_run ? "left as it was:" : "offset_s written into",
               arguments.session_file.string());
    return absl::OkStatus();
}

std::string first_line(const std::string& text) {
    return text.substr(0, text.find('\n'));
}

int parse_and_run(int argc, char** argv) {
    CLI::App app(
        "Aligns videos that were not started together, by how the silhouettes of one moving person move, and "
        "writes "
        "each "
        "camera's offset_s into session.toml. Where that cannot be told for sure it says why and writes "
        "nothing.",
        "kinevox sync");
    Arguments arguments;
    declare(app, arguments);
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        fmt::print(stderr, "kinevox sync: {}; see kinevox sync --help\n", first_line(error.what()));
        return 1;
    }
    if (!arguments.plot.empty() && arguments.plot.extension() != ".png") {
        fmt::print(stderr, "kinevox sync: --plot is '{}'; give a file that ends in .png\n",
                   arguments.plot.string());
        return 1;
    }
    arguments.align.use_places = !arguments.no_places;
    silence_video_libraries();
    const absl::Status status = run(arguments);
    if (status.ok()) return 0;
    fmt::print(stderr, "kinevox sync: {}\n", std::string(status.message()));
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return parse_and_run(argc, argv);
    } catch (const std::exception& error) {
        fmt::print(stderr, "kinevox sync: {}\n", error.what());
        return 1;
    }
}
