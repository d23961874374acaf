#include "server/tools/calibrate/lens_verb.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "server/calibration/solved_certificate.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct LensArguments {
    std::vector<std::string> clips;
    std::string board, out;
    int every = 1;
    bool k3 = false, quiet = false;
};

absl::Status intrinsics(const LensArguments& arguments) {
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto sightings = find_boards(*clips, *board, {.every = arguments.every}, progress);
    if (!sightings.ok()) return sightings.status();
    auto lenses = solve_lenses(*clips, *board, *sightings, arguments.every, arguments.k3, progress);
    if (!lenses.ok()) return lenses.status();
    const Certificate certificate = lens_certificate(*std::move(lenses));
    print_lenses(certificate.lenses);
    return write_calibration(certificate, arguments.out);
}

}  // namespace

absl::StatusOr<std::vector<IntrinsicsResult>> solve_lenses(const std::vector<CameraClip>& clips,
                                                           const BoardSpec& board,
                                                           const BoardSightings& sightings, int every,
                                                           bool k3, const SolveProgress& progress) {
    IntrinsicsOptions options;
    options.k3 = k3;
    std::vector<IntrinsicsResult> results;
    for (std::size_t c = 0; c < clips.size(); ++c) {
        IntrinsicsProcedure procedure(clips[c].camera, clips[c].width, clips[c].height, board, options);
        for (std::size_t i = 0; i < sightings[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * every, sightings[c][i]);
        auto result = procedure.solve(progress);
        if (!result.ok()) return result.status();
        results.push_back(*std::move(result));
    }
    return results;
}

void print_lenses(const std::vector<IntrinsicsResult>& lenses) {
    fmt::print("{:12} {:>5} {:>8} {:>9} {:>16} {:>16} {:>8}\n", "camera", "views", "rms px", "held out",
               "fx px", "fy px", "covered");
    for (const IntrinsicsResult& lens : lenses)
        fmt::print("{:12} {:5} {:8.3f} {:>9} {:9.2f} ± {:4.2f} {:9.2f} ± {:4.2f} {:6.0f} %\n",
                   lens.camera.name, lens.used, lens.rms_px,
                   lens.held_out_rms_px ? fmt::format("{:.3f}", *lens.held_out_rms_px) : "-", lens.camera.fx,
                   lens.std_deviations[0], lens.camera.fy, lens.std_deviations[1], 100 * lens.coverage);
}

std::vector<Verb> lens_verbs(CLI::App& app) {
    const auto lens = std::make_shared<LensArguments>();
    CLI::App* const verb = app.add_subcommand("intrinsics", "Lenses from pictures of a board");
    verb->add_option(
            "clips", lens->clips,
            "NAME=FILE for each camera: a video or a folder of pictures of the board; or a session's "
            "session.toml")
        ->required();
    verb->add_option("--board", lens->board, kBoardHelp)->required();
    verb->add_option("--out", lens->out, "The calibration to write, .toml; its certificate goes beside it")
        ->required();
    verb->add_option("--every", lens->every, "Look at every so many pictures only")
        ->check(CLI::Range(1, 100000))
        ->capture_default_str();
    verb->add_flag("--k3", lens->k3, "A third radial coefficient, for very wide lenses");
    verb->add_flag("--quiet", lens->quiet, "No progress");
    return {{verb, [lens] { return intrinsics(*lens); }}};
}

}  // namespace kinevox::calibrate
