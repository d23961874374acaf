// kinevox-process: a recorded session through the pipeline, every frame set, no daemon.

#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/cameras/session_source.h"
#include "server/pipeline/huge_pages.h"
#include "server/tools/interrupt.h"
#include "server/tools/process/process.h"

namespace {

struct Arguments {
    kinevox::ProcessOptions options;
    double voxel_mm = 10;
    bool no_colouring = false, no_pose = false;
    int threads = 0;
};

// What CLI11 reports, as our one line.
std::string first_line(const std::string& text) {
    return text.substr(0, text.find('\n'));
}

void declare(CLI::App& app, Arguments& arguments, std::string& device, std::vector<std::string>& save) {
    kinevox::ProcessOptions& options = arguments.options;
    app.add_option("session", options.session_file, "The session's file, session.toml")->required();
    app.add_option("--out", options.out_folder, "Folder for the results; made if need be")->required();
    app.add_option("--save", save, "What to write besides the tables: silhouettes,volumes")
        ->delimiter(',')
        ->check(CLI::IsMember({"silhouettes", "volumes"}));
    app.add_option("--device", device, "cpu or cuda")
        ->check(CLI::IsMember({"cpu", "cuda"}))
        ->capture_default_str();
    app.add_option("--voxel-mm", arguments.voxel_mm, "Edge of a voxel, 1 to 200")->capture_default_str();
    app.add_option("--samples", options.pipeline.segmentation.samples, "Background samples per pixel, N")
        ->capture_default_str();
    app.add_flag("--no-colouring", arguments.no_colouring,
                 "Stop at the hull: no carving by colour, no colours");
    app.add_flag("--no-pose", arguments.no_pose, "Stop at the volume: no joints, no angles");
    app.add_option(
        "--tpose", options.tpose_file,
        "Session of the same person in a T-pose, for the body's size; without it the first seconds of "
        "movement tell it");
    app.add_option("--smooth-hz", options.poses.cutoff_hz,
                   "Cutoff of the poses' zero-phase low pass; 0: none")
        ->check(CLI::Range(0.0, 1000.0))
        ->capture_default_str();
    app.add_option("--threads", arguments.threads, "Threads of the pipeline; 0: one a core")
        ->check(CLI::Range(0, 1024))
        ->capture_default_str();
    app.add_option("--frames", options.max_frames, "Stop after so many frame sets; 0: all")
        ->check(CLI::Range(0, 1'000'000'000))
        ->capture_default_str();
    app.add_flag("--resume", options.resume,
                 "Do nothing where --out holds the results of the same input and options already");
    app.add_flag("--quiet", options.quiet, "No progress bar and no summary");
}

int run(int argc, char** argv) {
    CLI::App app("Takes a recorded session through the pipeline and writes tables, silhouettes and volumes.",
                 "kinevox process");
    Arguments arguments;
    std::string device = "cpu";
    std::vector<std::string> save;
    declare(app, arguments, device, save);
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        fmt::print(stderr, "kinevox process: {}; see kinevox process --help\n", first_line(error.what()));
        return 1;
    }
    kinevox::ProcessOptions& options = arguments.options;
    if (options.out_folder.empty()) {
        fmt::print(stderr, "kinevox process: --out is empty; give the folder for the results\n");
        return 1;
    }
    if (!(arguments.voxel_mm >= 1 && arguments.voxel_mm <= 200)) {  // NaN neither
        fmt::print(stderr, "kinevox process: --voxel-mm is {:g}; give 1 to 200\n", arguments.voxel_mm);
        return 1;
    }
    options.pipeline.device =
        device == "cuda" ? kinevox::kernels::Device::kCuda : kinevox::kernels::Device::kCpu;
    options.pipeline.voxel_m = arguments.voxel_mm / 1000;
    options.pipeline.colouring = !arguments.no_colouring;
    options.pipeline.pose = !arguments.no_pose;
    options.pipeline.posing.filtered = false;  // the whole recording is smoothed at the end
    for (const std::string& what : save)
        (what == "volumes" ? options.writer.save_volumes : options.writer.save_silhouettes) = true;

    kinevox::silence_video_libraries();
    std::atomic<bool> stop{false};
    const kinevox::Interrupt interrupt([&stop] { stop = true; });
    std::unique_ptr<oneapi::tbb::global_control> limit;
    if (arguments.threads > 0)
        limit = std::make_unique<oneapi::tbb::global_control>(
            oneapi::tbb::global_control::max_allowed_parallelism,
            static_cast<std::size_t>(arguments.threads));
    const absl::Status status = kinevox::process_session(options, stop);
    if (status.ok()) return 0;
    fmt::print(stderr, "kinevox process: {}\n", std::string(status.message()));
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    kinevox::restart_with_huge_pages(argv);
    try {
        return run(argc, argv);
    } catch (const std::exception& error) {
        fmt::print(stderr, "kinevox process: {}\n", error.what());
        return 1;
    }
}
