#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "server/calibration/certificate/solved_certificate.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/verbs.h"
#include "server/tools/console.h"

namespace kinevox::calibrate {
namespace {

struct IntrinsicsArguments {
    std::vector<std::string> clips;
    std::string board;
    int stride = 1;
    bool k3 = false;
    Output output;
};

absl::Status intrinsics(const IntrinsicsArguments& arguments) {
    if (absl::Status free = check_output(arguments.output); !free.ok()) return free;
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    const SolveProgress progress = console_progress(arguments.output.quiet);
    const auto detections = detect_boards(*clips, *board, {.stride = arguments.stride}, progress);
    if (!detections.ok()) return detections.status();
    auto solved = solve_intrinsics(*clips, *board, *detections, arguments.stride, arguments.k3, progress);
    if (!solved.ok()) return solved.status();
    const Certificate certificate = intrinsics_certificate(*std::move(solved));
    print_intrinsics(certificate.intrinsics, arguments.output);
    return write_calibration(certificate, arguments.output);
}

}  // namespace

absl::StatusOr<std::vector<IntrinsicsResult>> solve_intrinsics(const std::vector<CameraClip>& clips,
                                                               const BoardSpec& board,
                                                               const BoardDetections& detections, int stride,
                                                               bool k3, const SolveProgress& progress) {
    IntrinsicsOptions options;
    options.k3 = k3;
    std::vector<IntrinsicsResult> results;
    for (std::size_t c = 0; c < clips.size(); ++c) {
        IntrinsicsProcedure procedure(clips[c].camera, clips[c].width, clips[c].height, board, options);
        for (std::size_t i = 0; i < detections[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * stride, detections[c][i]);
        auto result = procedure.solve(progress);
        if (!result.ok()) return result.status();
        results.push_back(*std::move(result));
    }
    return results;
}

void print_intrinsics(const std::vector<IntrinsicsResult>& results, const Output& output) {
    output.print("{:12} {:>5} {:>8} {:>9} {:>16} {:>16} {:>8}\n", "camera", "views", "rms px", "held out",
                 "fx px", "fy px", "covered");
    for (const IntrinsicsResult& result : results)
        output.print("{:12} {:5} {:8.3f} {:>9} {:9.2f} ± {:4.2f} {:9.2f} ± {:4.2f} {:6.0f} %\n",
                     result.camera.name, result.used, result.rms_px,
                     result.held_out_rms_px ? fmt::format("{:.3f}", *result.held_out_rms_px) : "-",
                     result.camera.fx, result.stds[0], result.camera.fy, result.stds[1],
                     100 * result.coverage);
}

std::vector<Verb> intrinsics_verbs(CLI::App& app) {
    const auto arguments = std::make_shared<IntrinsicsArguments>();
    CLI::App* const verb = app.add_subcommand("intrinsics", "Estimate intrinsics from images of a board");
    verb->add_option("videos", arguments->clips,
                     "NAME=FILE per camera: a video or a folder of images of the board; or a session.toml")
        ->required();
    verb->add_option("--board", arguments->board, kBoardHelp)->required();
    declare_output(*verb, arguments->output);
    verb->add_option("--stride", arguments->stride, "Use every Nth image")
        ->check(CLI::Range(1, 100000))
        ->capture_default_str();
    verb->add_flag("--k3", arguments->k3,
                   "Estimate a third radial distortion coefficient (very wide lenses)");
    return {{verb, [arguments] { return intrinsics(*arguments); }}};
}

}  // namespace kinevox::calibrate
