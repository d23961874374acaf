// kinevox-process: every frame set of a recorded session through the pipeline, without a daemon.
#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/command_line.h"
#include "server/cameras/session_source.h"
#include "server/config/daemon_config.h"
#include "server/pipeline/pipeline_resources.h"
#include "server/tools/console.h"
#include "server/tools/process/process.h"

namespace {

struct Arguments {
    kinevox::ProcessOptions options;
    std::string config_file, body_file, device = "cpu";  // device: see kDeviceNames
    std::vector<std::string> save;
    double voxel_mm = 10;
    bool no_colouring = false, no_pose = false;
    int threads = 0;
    bool json = false;
};

void declare(CLI::App& app, Arguments& arguments) {
    kinevox::ProcessOptions& options = arguments.options;
    app.add_option("SESSION", options.session_file, "Session file (session.toml)")->required();
    app.add_option("--out", options.out_folder, "Output folder (created)")->required();
    app.add_flag("--overwrite", options.overwrite, "Replace the results of another run in --out");
    app.add_option("--save", arguments.save,
                   "Additional outputs: silhouettes,volumes,hulls (hulls: the volumes before colour carving)")
        ->delimiter(',')
        ->check(CLI::IsMember({"silhouettes", "volumes", "hulls"}));
    app.add_option("--config", arguments.config_file,
                   "Configuration file of the daemon that supplies the pipeline's options; the options below "
                   "override it");
    app.add_option("--device", arguments.device,
                   std::string("Compute device: ") + kinevox::kernels::kDeviceNames)
        ->check(CLI::Validator(
            [](const std::string& name) {
                if (kinevox::kernels::device_of_name(name)) return std::string();
                return fmt::format("'{}' is unknown; use {}", name, kinevox::kernels::kDeviceNames);
            },
            "{cpu,cuda}"))
        ->capture_default_str();
    app.add_option("--voxel-mm", arguments.voxel_mm, "Voxel edge (mm)")->capture_default_str();
    app.add_option("--background-samples", options.pipeline.segmentation.samples,
                   "Background samples per pixel")
        ->capture_default_str();
    app.add_option("--max-subjects", options.pipeline.tracker.max_subjects,
                   "Maximum number of subjects followed at once")
        ->check(CLI::Range(1, 16))
        ->capture_default_str();
    app.add_flag("--no-colouring", arguments.no_colouring, "Skip colour carving");
    app.add_flag("--no-pose", arguments.no_pose, "Skip pose estimation");
    app.add_option(
        "--tpose", options.tpose_file,
        "T-pose session of the same subject, to fit the body (default: first seconds of movement)");
    app.add_option(
           "--body", arguments.body_file,
           "Body file of the subject, as in body.toml (default: fitted to the T-pose or the movement)")
        ->excludes("--tpose");
    app.add_option("--stature", options.poses.body.stature_m,
                   "Measured stature of the subject with shoes (m; default: estimated)")
        ->check(CLI::Range(0.5, 2.5))
        ->excludes("--body");
    app.add_flag("--single-run", options.single_run,
                 "Do not process the session again where silhouettes may lack parts of the subject");
    app.add_option("--smooth-hz", options.poses.cutoff_hz,
                   "Zero-phase low-pass cutoff (Hz; 0: off); needs a frame rate of three times the cutoff")
        ->check(CLI::Range(0.0, 1000.0))
        ->capture_default_str();
    app.add_option("--threads", arguments.threads, "Worker threads (0: one per core)")->capture_default_str();
    app.add_option("--every", options.every, "Process every Nth frame set only")
        ->check(CLI::Range(1, 1'000'000))
        ->capture_default_str();
    app.add_option("--frames", options.max_frames, "Maximum number of frame sets (0: all)")
        ->check(CLI::Range(0, 1'000'000'000))
        ->capture_default_str();
    app.add_flag("--resume", options.resume,
                 "Skip if --out already holds results of the same input and options");
    app.add_flag("--json", arguments.json, "Print one JSON object instead of the summary");
    app.add_flag("--quiet", options.quiet, "Print errors only");
}

// The pipeline's options from the configuration file; those of the command line override them.
absl::Status apply_config(const CLI::App& app, Arguments& arguments) {
    if (arguments.config_file.empty()) return absl::OkStatus();
    auto config = kinevox::read_config(arguments.config_file, false);
    if (!config.ok()) return config.status();
    config->pose.body_file.clear();  // the body is fitted to the session
    auto pipeline = kinevox::pipeline_options(*config);
    if (!pipeline.ok()) return pipeline.status();
    const int samples = arguments.options.pipeline.segmentation.samples;
    const int max_subjects = arguments.options.pipeline.tracker.max_subjects;
    arguments.options.pipeline = *std::move(pipeline);
    if (app.count("--max-subjects") > 0) arguments.options.pipeline.tracker.max_subjects = max_subjects;
    if (app.count("--background-samples") > 0) arguments.options.pipeline.segmentation.samples = samples;
    if (app.count("--device") == 0) arguments.device = kinevox::kernels::name_of(config->pipeline.device);
    if (app.count("--voxel-mm") == 0) arguments.voxel_mm = config->pipeline.voxel_mm;
    if (app.count("--threads") == 0) arguments.threads = config->pipeline.threads;
    arguments.no_colouring = arguments.no_colouring || !config->pipeline.colouring;
    arguments.no_pose = arguments.no_pose || !config->pose.enabled;
    return absl::OkStatus();
}

absl::Status run(const CLI::App& app, Arguments& arguments) {
    if (absl::Status applied = apply_config(app, arguments); !applied.ok()) return applied;
    kinevox::ProcessOptions& options = arguments.options;
    if (options.out_folder.empty())
        return absl::InvalidArgumentError("--out is empty; give a folder for the results");
    const kinevox::PipelineConfig given{.voxel_mm = arguments.voxel_mm, .threads = arguments.threads};
    if (std::string problem = kinevox::kernels::check_ranges(given); !problem.empty()) {
        std::ranges::replace(problem, '_', '-');  // the key of [pipeline] is the option's name
        return absl::InvalidArgumentError("--" + problem);
    }
    options.pipeline.device = kinevox::kernels::device_of_name(arguments.device).value();
    options.pipeline.voxel_m = arguments.voxel_mm / 1000;
    options.pipeline.colouring = !arguments.no_colouring;
    options.pipeline.pose = !arguments.no_pose;
    if (!arguments.body_file.empty()) {
        auto body = kinevox::read_body_shape(arguments.body_file);
        if (!body.ok()) return body.status();
        options.pipeline.posing.set_body(*body);
        options.poses.fit_body = false;
    }
    if (options.poses.body.stature_m)
        options.pipeline.posing.body = kinevox::default_body_shape(*options.poses.body.stature_m);
    options.pipeline.posing.filtered = false;  // the whole recording is smoothed at the end
    const auto saves = [&](const char* what) {
        return std::ranges::find(arguments.save, what) != arguments.save.end();
    };
    options.writer.save_silhouettes = saves("silhouettes");
    options.writer.save_volumes = saves("volumes");
    options.writer.save_hulls = options.pipeline.keep_hulls = saves("hulls");
    options.quiet = options.quiet || arguments.json;

    kinevox::silence_video_libraries();
    std::atomic<bool> stop{false};
    const kinevox::Interrupt interrupt([&stop] { stop = true; });
    std::unique_ptr<oneapi::tbb::global_control> limit;
    if (arguments.threads > 0)
        limit = std::make_unique<oneapi::tbb::global_control>(
            oneapi::tbb::global_control::max_allowed_parallelism,
            static_cast<std::size_t>(arguments.threads));
    const absl::Status status = kinevox::process_session(options, stop);
    if (status.ok() && arguments.json)
        fmt::print("{}\n", nlohmann::ordered_json({{"out", options.out_folder.string()}}).dump());
    return status;
}

}  // namespace

int main(int argc, char** argv) {
    kinevox::restart_with_huge_pages(argv);
    CLI::App app("Process a recorded session into tables, silhouettes and volumes.", "kinevox process");
    Arguments arguments;
    declare(app, arguments);
    return kinevox::tool_main(app, argc, argv, [&] { return run(app, arguments); });
}
