// kinevox-sync: temporal alignment of videos by silhouette motion.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <system_error>
#include <vector>

#include "common/command_line.h"
#include "common/files.h"
#include "common/session_file.h"
#include "server/calibration/certificate/certificate.h"
#include "server/cameras/session_source.h"
#include "server/sync/offsets.h"
#include "server/tools/console.h"

namespace {

namespace fs = std::filesystem;
using namespace kinevox;
using namespace kinevox::sync;
using Json = nlohmann::ordered_json;

Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json rounded(const std::vector<double>& values, double step) {
    Json list = Json::array();
    for (const double v : values)
        list.push_back(std::isfinite(v) ? Json(std::round(v / step) * step) : Json(nullptr));
    return list;
}

// Several lines.
std::string table_of(const Session& session, const Alignment& alignment) {
    std::size_t width = 6;
    for (const SessionCamera& camera : session.cameras) width = std::max(width, camera.name.size());
    std::string out = fmt::format("{:<{}} {:>10} {:>8} {:>9} {:>9}  {}\n", "camera", width, "offset s",
                                  "std s", "frames", "evidence", "runner-up");
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        const std::string runner_up =
            fit.runner_up > 0
                ? fmt::format("{:+.3f} s, {:.0f} % as good", fit.runner_up_offset_s, 100 * fit.runner_up)
                : "none";
        out +=
            fmt::format("{:<{}} {:>10.4f} {:>8.4f} {:>9.2f} {:>9.0f}  {}\n", session.cameras[c].name, width,
                        fit.offset_s, fit.std_s, fit.offset_s * session.fps, fit.evidence, runner_up);
    }
    return out;
}

// Offsets and standard deviations per camera, and pairs; units in the keys.
Json json_of(const Session& session, const Alignment& alignment) {
    Json cameras = Json::array(), pairs = Json::array();
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        cameras.push_back({{"name", session.cameras[c].name},
                           {"offset_s", fit.offset_s},
                           {"std_s", fit.std_s},
                           {"evidence_nats", fit.evidence},
                           {"runner_up_ratio", fit.runner_up},
                           {"runner_up_offset_s", fit.runner_up_offset_s}});
    }
    for (const PairFit& pair : alignment.solution.pairs) {
        Json one = {{"first", session.cameras[pair.first].name},
                    {"second", session.cameras[pair.second].name},
                    {"lag_s", number(pair.lag_frames / session.fps)},
                    {"std_s", number(pair.std_frames / session.fps)},
                    {"residual_s", number(pair.residual_frames / session.fps)},
                    {"weight", pair.weight},
                    {"evidence_nats", pair.evidence}};
        one["silhouette_residual_px"] = pair.residual_px ? Json(*pair.residual_px) : Json(nullptr);
        pairs.push_back(std::move(one));
    }
    return {{"kind", "alignment"},
            {"session", session.name},
            {"fps", session.fps},
            {"used_extrinsics", alignment.used_extrinsics},
            {"cameras", std::move(cameras)},
            {"pairs", std::move(pairs)}};
}

// The same with the curves and signals of the page.
Json page_json_of(const Session& session, const Alignment& alignment) {
    Json out = json_of(session, alignment);
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        const CameraFit& fit = alignment.solution.cameras[c];
        Json& camera = out["cameras"][c];
        camera["curve"] = {{"first_offset_s", fit.curve.lowest_frames / session.fps},
                           {"evidence_nats", rounded(fit.curve.evidence, 0.01)}};
        camera["changed_fraction_per_s"] = rounded(alignment.movements[c].changed_fraction, 1e-4);
        camera["top_rises_per_s"] = rounded(alignment.movements[c].top, 1e-4);
    }
    return out;
}

struct Arguments {
    fs::path session_file, plot;
    AlignOptions align;
    bool dry_run = false, no_plot = false, no_extrinsics = false, overwrite = false, json = false,
         quiet = false;
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
    app.add_flag("--overwrite", arguments.overwrite, "Replace an existing file given by --plot");
    app.add_flag("--json", arguments.json, "Print one JSON object");
    app.add_flag("--quiet", arguments.quiet, "Print no progress");
}

// Through a temporary file: another program draws the page.
absl::Status draw_page(const Session& session, const Alignment& alignment, const fs::path& plot) {
    std::error_code error;
    const fs::path json = fs::temp_directory_path(error) / fmt::format("kinevox-sync-{}.json", getpid());
    if (error) return absl::UnavailableError("no folder for temporary files; set TMPDIR");
    absl::Status status = write_file_atomically(json, page_json_of(session, alignment).dump());
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
    const auto motion = read_motion(*session, {}, console_progress(arguments.quiet));
    if (!motion.ok()) return motion.status();
    const auto alignment = align(*motion, session->fps, arguments.align);
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
        for (const CameraFit& camera : alignment->solution.cameras) offsets.push_back(camera.offset_s);
        if (absl::Status written = write_offsets(arguments.session_file, offsets); !written.ok())
            return written;
    }
    if (arguments.json) {
        auto json = json_of(*session, *alignment);
        json["written"] = !arguments.dry_run;
        json["plot"] = drawn ? nlohmann::ordered_json(plot.string()) : nlohmann::ordered_json(nullptr);
        fmt::print("{}\n", json.dump());
        return absl::OkStatus();
    }
    fmt::print("{}", table_of(*session, *alignment));
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
    Arguments arguments;
    declare(app, arguments);
    return tool_main(app, argc, argv, [&]() -> absl::Status {
        if (!arguments.plot.empty() && arguments.plot.extension() != ".png")
            return absl::InvalidArgumentError(
                fmt::format("--plot is '{}'; give a file that ends in .png", arguments.plot.string()));
        std::error_code error;
        if (!arguments.overwrite && !arguments.no_plot && !arguments.plot.empty() &&
            fs::exists(arguments.plot, error))
            return absl::AlreadyExistsError(
                fmt::format("{}: exists; give another --plot, or --overwrite", arguments.plot.string()));
        arguments.align.use_extrinsics = !arguments.no_extrinsics;
        silence_video_libraries();
        return run(arguments);
    });
}
