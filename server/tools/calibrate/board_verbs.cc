// Lenses and places of cameras from pictures of a board.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "common/calibration_file.h"
#include "server/calibration/board_clips.h"
#include "server/calibration/extrinsics.h"
#include "server/calibration/intrinsics.h"
#include "server/calibration/solved_certificate.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct BoardArguments {
    std::vector<std::string> clips;
    std::string board, out, lenses;
    int every = 1, floor_frame = -1;
    bool k3 = false, quiet = false, refine_lenses = false;
};

using Sightings = std::vector<std::vector<BoardSighting>>;

absl::StatusOr<std::vector<IntrinsicsResult>> solve_lenses(const std::vector<CameraClip>& clips,
                                                           const BoardSpec& board, const Sightings& sightings,
                                                           const BoardArguments& arguments,
                                                           const SolveProgress& progress) {
    IntrinsicsOptions options;
    options.k3 = arguments.k3;
    std::vector<IntrinsicsResult> results;
    for (std::size_t c = 0; c < clips.size(); ++c) {
        IntrinsicsProcedure procedure(clips[c].camera, clips[c].width, clips[c].height, board, options);
        for (std::size_t i = 0; i < sightings[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * arguments.every, sightings[c][i]);
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

absl::Status intrinsics(const BoardArguments& arguments) {
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto sightings = find_boards(*clips, *board, arguments.every, progress);
    if (!sightings.ok()) return sightings.status();
    auto lenses = solve_lenses(*clips, *board, *sightings, arguments, progress);
    if (!lenses.ok()) return lenses.status();
    const Certificate certificate = lens_certificate(*std::move(lenses));
    print_lenses(certificate.lenses);
    return write_calibration(certificate, arguments.out);
}

absl::StatusOr<std::vector<Camera>> lenses_of_clips(const std::string& file,
                                                    const std::vector<CameraClip>& clips) {
    const auto all = read_calibration(file);
    if (!all.ok()) return all.status();
    std::vector<Camera> lenses;
    for (const CameraClip& clip : clips) {
        const Camera* const found = camera_named(*all, clip.camera);
        if (!found)
            return absl::NotFoundError(fmt::format(
                "{}: has no camera {}; name the clip as the camera, NAME=FILE", file, clip.camera));
        if (found->width != clip.width || found->height != clip.height)
            return absl::InvalidArgumentError(fmt::format(
                "{}: camera {} is {} x {} px, {} is {} x {}; calibrate its lens at "
                "the clip's size",
                file, clip.camera, found->width, found->height, clip.file.string(), clip.width, clip.height));
        lenses.push_back(*found);
    }
    return lenses;
}

void print_extrinsics(const ExtrinsicsResult& result) {
    fmt::print("{:12} {:>5} {:>8} {:>9} {:>8}  {}\n", "camera", "views", "fit px", "held out", "covered",
               "centre m");
    for (std::size_t c = 0; c < result.cameras.size(); ++c) {
        const CameraQuality& q = result.quality[c];
        const Vec3 centre = result.cameras[c].centre_in_world();
        fmt::print("{:12} {:5} {:8.3f} {:>9} {:6.0f} %  {:.3f} {:.3f} {:.3f}\n", result.cameras[c].name,
                   q.views, q.fit_rms_px, q.held_out_rms_px ? fmt::format("{:.3f}", *q.held_out_rms_px) : "-",
                   100 * q.coverage, centre.x, centre.y, centre.z);
    }
    if (result.held_out_rms_px) fmt::print("views kept out of the fit: {:.3f} px\n", *result.held_out_rms_px);
    for (std::size_t c = 0; c < result.delays.size(); ++c)
        if (std::abs(result.delays[c]) > 0.02)
            fmt::print("camera {} takes its pictures {:.2f} frames {}\n", result.cameras[c].name,
                       std::abs(result.delays[c]), result.delays[c] > 0 ? "late" : "early");
    if (result.scale)
        fmt::print("lengths: {:+.2f} mm/m, spread {:.2f} mm/m\n", result.scale->bias_mm_per_m,
                   result.scale->spread_mm_per_m);
}

absl::Status extrinsics(const BoardArguments& arguments) {
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    if (clips->size() < 2)
        return absl::InvalidArgumentError("one camera has no place among others; give two clips or more");
    absl::StatusOr<std::vector<Camera>> lenses = std::vector<Camera>{};
    if (!arguments.lenses.empty()) {
        lenses = lenses_of_clips(arguments.lenses, *clips);
        if (!lenses.ok()) return lenses.status();
    }
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto sightings = find_boards(*clips, *board, arguments.every, progress);
    if (!sightings.ok()) return sightings.status();
    Certificate with_lenses;
    if (arguments.lenses.empty()) {
        auto solved = solve_lenses(*clips, *board, *sightings, arguments, progress);
        if (!solved.ok()) return solved.status();
        with_lenses = lens_certificate(*std::move(solved));
        lenses = with_lenses.cameras;
        print_lenses(with_lenses.lenses);
    }
    ExtrinsicsOptions options;
    options.refine_lenses = arguments.refine_lenses || arguments.lenses.empty();
    ExtrinsicsProcedure procedure(*lenses, *board, options);
    for (std::size_t c = 0; c < clips->size(); ++c)
        for (std::size_t i = 0; i < (*sightings)[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * arguments.every, static_cast<int>(c),
                                      (*sightings)[c][i]);
    auto result = procedure.solve(progress);
    if (!result.ok()) return result.status();
    print_extrinsics(*result);
    if (arguments.floor_frame >= 0)
        if (absl::Status set = set_world_by_board({&arguments.floor_frame, 1}, *result); !set.ok())
            return absl::InvalidArgumentError(
                fmt::format("--floor-frame {}: {}", arguments.floor_frame, std::string(set.message())));
    Certificate certificate = place_certificate("board", *std::move(result), arguments.floor_frame >= 0);
    certificate.lenses = std::move(with_lenses.lenses);
    certificate.findings.insert(certificate.findings.begin(), with_lenses.findings.begin(), with_lenses.findings.end());
    return write_calibration(certificate, arguments.out);
}

CLI::App* declare(CLI::App& app, const char* name, const char* about, BoardArguments& arguments) {
    CLI::App* const verb = app.add_subcommand(name, about);
    verb->add_option("clips", arguments.clips,
                     "NAME=FILE for each camera: a video or a folder of pictures of the board")
        ->required();
    verb->add_option("--board", arguments.board,
                     "checkerboard:4x7:60 (inner corners, mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] "
                     "(squares, square "
                     "mm, marker mm) or aprilgrid:6x6:88:26.4 (tags, tag mm, gap mm)")
        ->required();
    verb->add_option("--out", arguments.out,
                     "The calibration to write, .toml; its certificate goes beside it")
        ->required();
    verb->add_option("--every", arguments.every, "Look at every so many pictures only")
        ->check(CLI::Range(1, 100000))
        ->capture_default_str();
    verb->add_flag("--k3", arguments.k3, "A third radial coefficient, for very wide lenses");
    verb->add_flag("--quiet", arguments.quiet, "No progress");
    return verb;
}

}  // namespace

std::vector<Verb> board_verbs(CLI::App& app) {
    const auto lens = std::make_shared<BoardArguments>(), place = std::make_shared<BoardArguments>();
    CLI::App* const intrinsics_verb = declare(app, "intrinsics", "Lenses from pictures of a board", *lens);
    CLI::App* const extrinsics_verb =
        declare(app, "extrinsics",
                "Places of cameras from synchronised videos of a board moved through the space", *place);
    extrinsics_verb->add_option(
        "--lenses", place->lenses,
        "Calibration with the cameras' lenses; without it they come from the same videos");
    extrinsics_verb->add_flag("--refine-lenses", place->refine_lenses,
                              "Let the lenses move a little with the places");
    extrinsics_verb
        ->add_option("--floor-frame", place->floor_frame,
                     "Frame in which the board lies on the floor, print up: its lower left corner becomes "
                     "the origin, z up")
        ->check(CLI::NonNegativeNumber);
    return {{intrinsics_verb, [lens] { return intrinsics(*lens); }},
            {extrinsics_verb, [place] { return extrinsics(*place); }}};
}

}  // namespace kinevox::calibrate
