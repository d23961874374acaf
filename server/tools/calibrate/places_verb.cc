// Places of cameras from a board or a wand that was moved through the space.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/calibration/extrinsics.h"
#include "server/calibration/solved_certificate.h"
#include "server/calibration/wand.h"
#include "server/calibration/wand_clips.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/calibrate/lens_verb.h"
#include "server/tools/calibrate/person_verb.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct PlacesArguments {
    std::vector<std::string> clips;
    std::string board, wand, out, lenses;
    int every = 1, floor_frame = -1;
    bool k3 = false, quiet = false, refine_lenses = false, person = false;
    double height_m = 0;
};

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
                "{}: camera {} is {} x {} px, {} is {} x {}; calibrate its lens at the clip's size", file,
                clip.camera, found->width, found->height, clip.file.string(), clip.width, clip.height));
        lenses.push_back(*found);
    }
    return lenses;
}

void print_places(const ExtrinsicsResult& result) {
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

// `lenses` come from the same pictures where they are empty, and into the certificate.
absl::StatusOr<ExtrinsicsResult> places_by_board(const std::vector<CameraClip>& clips,
                                                 std::vector<Camera> lenses, const PlacesArguments& arguments,
                                                 const SolveProgress& progress, Certificate& certificate) {
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto sightings = find_boards(clips, *board, {.every = arguments.every}, progress);
    if (!sightings.ok()) return sightings.status();
    const bool own_lenses = lenses.empty();
    if (own_lenses) {
        auto solved = solve_lenses(clips, *board, *sightings, arguments.every, arguments.k3, progress);
        if (!solved.ok()) return solved.status();
        certificate = lens_certificate(*std::move(solved));
        lenses = certificate.cameras;
        print_lenses(certificate.lenses);
    }
    ExtrinsicsOptions options;
    options.refine_lenses = arguments.refine_lenses || own_lenses;
    ExtrinsicsProcedure procedure(lenses, *board, options);
    for (std::size_t c = 0; c < clips.size(); ++c)
        for (std::size_t i = 0; i < (*sightings)[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * arguments.every, static_cast<int>(c),
                                      (*sightings)[c][i]);
    return procedure.solve(progress);
}

absl::StatusOr<ExtrinsicsResult> places_by_wand(const std::vector<CameraClip>& clips,
                                                const std::vector<Camera>& lenses,
                                                const PlacesArguments& arguments,
                                                const SolveProgress& progress, Certificate& certificate) {
    const auto wand = parse_wand(arguments.wand);
    if (!wand.ok()) return wand.status();
    if (lenses.empty())
        return absl::InvalidArgumentError(
            "a wand tells no lenses; give --lenses, a calibration that `kinevox calibrate intrinsics` made");
    if (arguments.floor_frame >= 0)
        return absl::InvalidArgumentError(
            "--floor-frame needs a board; set the floor afterwards with kinevox calibrate floor");
    const auto sightings = find_wands(clips, *wand, {.every = arguments.every}, progress);
    if (!sightings.ok()) return sightings.status();
    WandProcedure procedure(lenses, *wand);
    for (std::size_t c = 0; c < clips.size(); ++c) {
        int seen = 0;
        std::vector<double> changed;
        for (std::size_t i = 0; i < (*sightings)[c].size(); ++i) {
            const WandPicture& picture = (*sightings)[c][i];
            procedure.add_observation(static_cast<int>(i) * arguments.every, static_cast<int>(c),
                                      picture.wand);
            seen += picture.wand.has_value();
            changed.push_back(picture.changed);
        }
        fmt::print("{:12} the wand was found in {} of {} pictures\n", clips[c].camera, seen,
                   (*sightings)[c].size());
        if (const int since = changed_for_good(changed); since >= 0)
            certificate.findings.push_back(
                {Verdict::kNoGo, "knocked", clips[c].camera,
                 fmt::format(
                     "camera {} sees another scene from frame {} on: it was knocked, or the light changed",
                     clips[c].camera, since * arguments.every),
                 "fix the camera firmly and record the wand again"});
    }
    return procedure.solve(progress);
}

absl::Status by_person(const PlacesArguments& arguments) {
    if (!arguments.board.empty() || !arguments.wand.empty())
        return absl::InvalidArgumentError(
            "what was moved through the space? Give one of --board and --wand, or --person");
    if (!is_session(arguments.clips))
        return absl::InvalidArgumentError("--person takes one file, the session.toml of a person who walks");
    PersonArguments person{arguments.clips.front(), arguments.lenses, arguments.out, arguments.height_m};
    person.quiet = arguments.quiet;
    return person_extrinsics(person);
}

absl::Status extrinsics(const PlacesArguments& arguments) {
    if (arguments.person) return by_person(arguments);
    if (arguments.board.empty() == arguments.wand.empty())
        return absl::InvalidArgumentError(
            "what was moved through the space? Give one of --board and --wand, or --person");
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    if (clips->size() < 2)
        return absl::InvalidArgumentError("one camera has no place among others; give two clips or more");
    absl::StatusOr<std::vector<Camera>> lenses = std::vector<Camera>{};
    std::string lens_file = arguments.lenses;
    if (lens_file.empty() && !arguments.wand.empty() && is_session(arguments.clips)) {
        const auto session = read_session(arguments.clips.front());
        if (!session.ok()) return session.status();
        lens_file = session->calibration.string();
    }
    if (!lens_file.empty()) {
        lenses = lenses_of_clips(lens_file, *clips);
        if (!lenses.ok()) return lenses.status();
    }
    const SolveProgress progress = console_progress(arguments.quiet);
    Certificate early;  // the lenses, and what the pictures told before any solve
    auto result = arguments.wand.empty() ? places_by_board(*clips, *lenses, arguments, progress, early)
                                         : places_by_wand(*clips, *lenses, arguments, progress, early);
    if (!result.ok()) return result.status();
    if (arguments.floor_frame >= 0)
        if (absl::Status set = set_world_by_board({&arguments.floor_frame, 1}, *result); !set.ok())
            return absl::InvalidArgumentError(
                fmt::format("--floor-frame {}: {}", arguments.floor_frame, std::string(set.message())));
    print_places(*result);
    Certificate certificate = place_certificate(arguments.wand.empty() ? "board" : "wand", *std::move(result),
                                                arguments.floor_frame >= 0);
    certificate.lenses = std::move(early.lenses);
    certificate.findings.insert(certificate.findings.begin(), early.findings.begin(), early.findings.end());
    return write_calibration(certificate, arguments.out);
}

}  // namespace

std::vector<Verb> places_verbs(CLI::App& app) {
    const auto places = std::make_shared<PlacesArguments>();
    CLI::App* const verb = app.add_subcommand("extrinsics",
                                              "Places of cameras from synchronised videos of a board or a "
                                              "wand moved, or a person who walked, through the space");
    verb->add_option(
            "clips", places->clips,
            "NAME=FILE for each camera: a video or a folder of pictures; or a session's session.toml")
        ->required();
    verb->add_option("--board", places->board, kBoardHelp);
    verb->add_option(
        "--wand", places->wand,
        "Instead of a board: wand:200:600 (mm from the first ball to the second and to the third) or "
        "wand:600 (two balls)");
    verb->add_flag(
        "--person", places->person,
        "Instead of a board: a person who walks upright round through the space, in a session.toml whose "
        "calibration (or --lenses) gives the lenses");
    verb->add_option("--height", places->height_m, "m, of that person with shoes and hair: gives the scale")
        ->check(CLI::Range(0.5, 2.6));
    verb->add_option("--out", places->out, "The calibration to write, .toml; its certificate goes beside it")
        ->required();
    verb->add_option("--lenses", places->lenses,
                     "Calibration with the cameras' lenses; without it they come from the same videos of the "
                     "board, or, for a "
                     "wand, from the session's calibration");
    verb->add_flag("--refine-lenses", places->refine_lenses, "Let the lenses move a little with the places");
    verb->add_option(
            "--floor-frame", places->floor_frame,
            "Frame in which the board lies on the floor, print up: its lower left corner becomes the origin, "
            "z up")
        ->check(CLI::NonNegativeNumber);
    verb->add_option("--every", places->every, "Look at every so many pictures only")
        ->check(CLI::Range(1, 100000))
        ->capture_default_str();
    verb->add_flag("--k3", places->k3, "A third radial coefficient, for very wide lenses");
    verb->add_flag("--quiet", places->quiet, "No progress");
    return {{verb, [places] { return extrinsics(*places); }}};
}

}  // namespace kinevox::calibrate
