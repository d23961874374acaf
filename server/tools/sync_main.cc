// kinevox-sync: temporal alignment of videos by silhouette motion.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "common/atomic_file.h"
#include "common/command_line.h"
#include "common/session_file.h"
#include "common/session_offsets.h"
#include "server/calibration/certificate/report_page.h"
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
    bool dry_run = false, no_plot = false, no_extrinsics = false, json = false, quiet = false;
};

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("session", arguments.session_file,
                   "Session (session.toml): a video, a background and calibrated intrinsics per camera")
        ->required();
    app.add_option("--max-offset", arguments.align.max_offset_s, "Largest offset between cameras (s)")
        ->check(CLI::Range(0.1, 3600.0))
        ->capture_default_str();
    app.add_flag("--no-extrinsics", arguments.no_extrinsics,
                 "Ignore extrinsics (automatic if the calibration has none)");
    app.add_flag("--dry-run", arguments.dry_run, "Report offsets without writing them");
    app.add_option("--plot", arguments.plot, "Plot file (.png; default: sync.png next to the session)");
    app.add_flag("--no-plot", arguments.no_plot, "Draw no plot");
    app.add_flag("--json", arguments.json, "Print one JSON object");
    app.add_flag("--quiet", arguments.quiet, "Print no progress");
}

// Through a temporary file: another program draws the page.
absl::Status draw_page(const Session& session, const sync::Alignment& alignment, const fs::path& plot) {
    std::error_code error;
    const fs::path json = fs::temp_directory_path(error) / fmt::format("kinevox-sync-{}.json", getpid());
    if (error) return absl::UnavailableError("no folder for temporary files; set TMPDIR");
    absl::Status status = write_file_atomically(json, sync::page_json_of(session, alignment).dump());
    if (status.ok()) status = draw_report_page(json, plot);
    if (status.code() == absl::StatusCode::kUnavailable)
        status = absl::UnavailableError(
            fmt::format("{} could not be drawn; is its folder writable, and is python3-matplotlib installed?",
                        plot.string()));
    fs::remove(json, error);
    return status;
}

absl::Status run(const Arguments& arguments) {
    const auto session = read_session(arguments.session_file);
    if (!session.ok()) return session.status();
    if (session->recording)
        return absl::FailedPreconditionError(fmt::format(
            "{}: recorded by kinevoxd, whose cameras are already synchronised; there is nothing to align",
            arguments.session_file.string()));
    const auto motion = sync::read_motion(*session, {}, calibrate::console_progress(arguments.quiet));
    if (!motion.ok()) return motion.status();
    const auto alignment = sync::align(*motion, session->fps, arguments.align);
    if (!alignment.ok()) return alignment.status();

    // The page first: a failure must not leave a partial result.
    const fs::path plot =
        arguments.plot.empty() ? arguments.session_file.parent_path() / "sync.png" : arguments.plot;
    bool drawn = false;
    if (!arguments.no_plot) {
        const absl::Status status = draw_page(*session, *alignment, plot);
        drawn = status.ok();
        if (!drawn) fmt::print(stderr, "kinevox sync: no plot: {}\n", std::string(status.message()));
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
    fmt::print("{}\n", alignment->used_extrinsics ? "from silhouette motion and extrinsics"
                                                  : "from silhouette motion, without extrinsics");
    if (drawn) fmt::print("plot in {}\n", plot.string());
    fmt::print("{} {}\n", arguments.dry_run ? "not changed:" : "offset_s written to",
               arguments.session_file.string());
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App app(
        "Estimate each camera's time offset from silhouette motion and write it to session.toml; reports why "
        "if it cannot.",
        "kinevox sync");
    app.footer(kExitStatusHelp);
    Arguments arguments;
    declare(app, arguments);
    return tool_main(app, argc, argv, [&]() -> absl::Status {
        if (!arguments.plot.empty() && arguments.plot.extension() != ".png")
            return absl::InvalidArgumentError(
                fmt::format("--plot is '{}'; give a file that ends in .png", arguments.plot.string()));
        arguments.align.use_extrinsics = !arguments.no_extrinsics;
        silence_video_libraries();
        return run(arguments);
    });
}
