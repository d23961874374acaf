// Extrinsics from a moving board, wand or person.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/calibration/board/extrinsics.h"
#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/wand/wand.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/verbs.h"
#include "server/tools/console.h"

namespace kinevox::calibrate {
namespace {

struct ExtrinsicsArguments {
    std::vector<std::string> clips;
    std::string board, wand, intrinsics;
    int stride = 1, board_on_floor_frame = -1;
    bool k3 = false, refine_intrinsics = false, person = false;
    double stature_m = 0;
    Output output;
};

absl::StatusOr<std::vector<Camera>> intrinsics_of_clips(const std::string& file,
                                                        const std::vector<CameraClip>& clips) {
    const auto all = read_calibration(file);
    if (!all.ok()) return all.status();
    std::vector<Camera> intrinsics;
    for (const CameraClip& clip : clips) {
        const Camera* const found = camera_named(*all, clip.camera);
        if (!found)
            return absl::NotFoundError(fmt::format(
                "{}: has no camera {}; name the clip as the camera, NAME=FILE", file, clip.camera));
        if (found->width != clip.width || found->height != clip.height)
            return absl::InvalidArgumentError(fmt::format(
                "{}: camera {} is {} x {} px, {} is {} x {}; calibrate its intrinsics at the clip's size",
                file, clip.camera, found->width, found->height, clip.file.string(), clip.width, clip.height));
        intrinsics.push_back(*found);
    }
    return intrinsics;
}

void print_extrinsics(const ExtrinsicsResult& result, const Output& output) {
    output.print("{:12} {:>5} {:>8} {:>9} {:>8}  {}\n", "camera", "views", "fit px", "held out", "covered",
                 "centre m");
    for (std::size_t c = 0; c < result.cameras.size(); ++c) {
        const CameraReprojection& q = result.reprojections[c];
        const Vec3 centre = result.cameras[c].centre_in_world();
        output.print("{:12} {:5} {:8.3f} {:>9} {:6.0f} %  {:.3f} {:.3f} {:.3f}\n", result.cameras[c].name,
                     q.views, q.fit_rms_px,
                     q.held_out_rms_px ? fmt::format("{:.3f}", *q.held_out_rms_px) : "-", 100 * q.coverage,
                     centre.x, centre.y, centre.z);
    }
    if (result.held_out_rms_px)
        output.print("held-out reprojection error {:.3f} px\n", *result.held_out_rms_px);
    for (std::size_t c = 0; c < result.delays.size(); ++c)
        if (std::abs(result.delays[c]) > 0.02)
            output.print("camera {} exposes {:.2f} frames {}\n", result.cameras[c].name,
                         std::abs(result.delays[c]), result.delays[c] > 0 ? "late" : "early");
    if (result.scale)
        output.print("lengths: {:+.2f} mm/m, spread {:.2f} mm/m\n", result.scale->bias_mm_per_m,
                     result.scale->spread_mm_per_m);
}

// Empty `intrinsics` are estimated from the same images, and added to the certificate.
absl::StatusOr<ExtrinsicsResult> extrinsics_by_board(const std::vector<CameraClip>& clips,
                                                     std::vector<Camera> intrinsics,
                                                     const ExtrinsicsArguments& arguments,
                                                     const SolveProgress& progress,
                                                     Certificate& certificate) {
    const auto board = parse_board(arguments.board);
    if (!board.ok()) return board.status();
    const auto detections = detect_boards(clips, *board, {.stride = arguments.stride}, progress);
    if (!detections.ok()) return detections.status();
    const bool own_intrinsics = intrinsics.empty();
    if (own_intrinsics) {
        auto solved = solve_intrinsics(clips, *board, *detections, arguments.stride, arguments.k3, progress);
        if (!solved.ok()) return solved.status();
        certificate = intrinsics_certificate(*std::move(solved));
        intrinsics = certificate.cameras;
        print_intrinsics(certificate.intrinsics, arguments.output);
    }
    ExtrinsicsOptions options;
    options.refine_intrinsics = arguments.refine_intrinsics || own_intrinsics;
    ExtrinsicsProcedure procedure(intrinsics, *board, options);
    for (std::size_t c = 0; c < clips.size(); ++c)
        for (std::size_t i = 0; i < (*detections)[c].size(); ++i)
            procedure.add_observation(static_cast<int>(i) * arguments.stride, static_cast<int>(c),
                                      (*detections)[c][i]);
    return procedure.solve(progress);
}

absl::StatusOr<ExtrinsicsResult> extrinsics_by_wand(const std::vector<CameraClip>& clips,
                                                    const std::vector<Camera>& intrinsics,
                                                    const ExtrinsicsArguments& arguments,
                                                    const SolveProgress& progress, Certificate& certificate) {
    const auto wand = parse_wand(arguments.wand);
    if (!wand.ok()) return wand.status();
    if (intrinsics.empty())
        return absl::InvalidArgumentError(
            "a wand cannot determine intrinsics; give --intrinsics, a calibration from kinevox calibrate "
            "intrinsics");
    if (arguments.board_on_floor_frame >= 0)
        return absl::InvalidArgumentError(
            "--board-on-floor-frame needs a board; define the floor afterwards with kinevox calibrate floor");
    const auto detections = detect_wands(clips, *wand, {.stride = arguments.stride}, progress);
    if (!detections.ok()) return detections.status();
    WandProcedure procedure(intrinsics, *wand);
    for (std::size_t c = 0; c < clips.size(); ++c) {
        int seen = 0;
        std::vector<double> changed;
        for (std::size_t i = 0; i < (*detections)[c].size(); ++i) {
            const WandImage& image = (*detections)[c][i];
            procedure.add_observation(static_cast<int>(i) * arguments.stride, static_cast<int>(c),
                                      image.wand);
            seen += image.wand.has_value();
            changed.push_back(image.changed);
        }
        arguments.output.print("{:12} the wand was detected in {} of {} images\n", clips[c].camera, seen,
                               (*detections)[c].size());
        if (const int since = first_permanent_change(changed); since >= 0)
            certificate.findings.push_back(
                {Verdict::kNoGo, "camera_moved", clips[c].camera,
                 fmt::format(
                     "camera {} shows another scene from frame {} on: it was moved, or the light changed",
                     clips[c].camera, since * arguments.stride),
                 "fix the camera firmly and record the wand again"});
    }
    return procedure.solve(progress);
}

absl::Status by_person(const ExtrinsicsArguments& arguments) {
    if (!arguments.board.empty() || !arguments.wand.empty())
        return absl::InvalidArgumentError("no target given; use one of --board, --wand, --person");
    if (!is_session(arguments.clips))
        return absl::InvalidArgumentError("--person takes one file, the session.toml of a walking person");
    PersonArguments person{arguments.clips.front(), arguments.intrinsics, arguments.stature_m};
    person.output = arguments.output;
    return person_extrinsics(person);
}

absl::Status extrinsics(const ExtrinsicsArguments& arguments) {
    if (absl::Status free = check_output(arguments.output); !free.ok()) return free;
    if (arguments.person) return by_person(arguments);
    if (arguments.board.empty() == arguments.wand.empty())
        return absl::InvalidArgumentError("no target given; use one of --board, --wand, --person");
    const auto clips = open_clips(arguments.clips);
    if (!clips.ok()) return clips.status();
    if (clips->size() < 2)
        return absl::InvalidArgumentError("extrinsics need at least two cameras; give two or more videos");
    absl::StatusOr<std::vector<Camera>> intrinsics = std::vector<Camera>{};
    std::string intrinsics_file = arguments.intrinsics;
    if (intrinsics_file.empty() && !arguments.wand.empty() && is_session(arguments.clips)) {
        const auto session = read_session(arguments.clips.front());
        if (!session.ok()) return session.status();
        intrinsics_file = session->calibration.string();
    }
    if (!intrinsics_file.empty()) {
        intrinsics = intrinsics_of_clips(intrinsics_file, *clips);
        if (!intrinsics.ok()) return intrinsics.status();
    }
    const SolveProgress progress = console_progress(arguments.output.quiet);
    Certificate early;  // intrinsics, and findings from before the solve
    auto result = arguments.wand.empty()
                      ? extrinsics_by_board(*clips, *intrinsics, arguments, progress, early)
                      : extrinsics_by_wand(*clips, *intrinsics, arguments, progress, early);
    if (!result.ok()) return result.status();
    if (arguments.board_on_floor_frame >= 0)
        if (absl::Status set = define_world_by_board({&arguments.board_on_floor_frame, 1}, *result);
            !set.ok())
            return absl::InvalidArgumentError(fmt::format(
                "--board-on-floor-frame {}: {}", arguments.board_on_floor_frame, std::string(set.message())));
    print_extrinsics(*result, arguments.output);
    Certificate certificate =
        extrinsics_certificate(arguments.wand.empty() ? "extrinsics_board" : "extrinsics_wand",
                               *std::move(result), arguments.board_on_floor_frame >= 0);
    certificate.intrinsics = std::move(early.intrinsics);
    certificate.findings.insert(certificate.findings.begin(), early.findings.begin(), early.findings.end());
    return write_calibration(certificate, arguments.output);
}

}  // namespace

std::vector<Verb> extrinsics_verbs(CLI::App& app) {
    const auto arguments = std::make_shared<ExtrinsicsArguments>();
    CLI::App* const verb =
        app.add_subcommand("extrinsics", "Estimate extrinsics from a moving board, wand or person");
    verb->add_option("videos", arguments->clips,
                     "NAME=FILE per camera: a video or a folder of images, synchronised; or a session.toml")
        ->required();
    verb->add_option("--board", arguments->board, std::string("Board: ") + kBoardHelp);
    verb->add_option(
        "--wand", arguments->wand,
        "Wand instead of a board: wand:200:600 (mm from the first ball) or wand:600 (two balls)");
    verb->add_flag("--person", arguments->person, "Use a walking person (one session.toml; needs --stature)");
    verb->add_option("--stature", arguments->stature_m, "Subject's height (m, with shoes); sets the scale")
        ->check(CLI::Range(0.5, 2.6));
    declare_output(*verb, arguments->output);
    verb->add_option(
        "--intrinsics", arguments->intrinsics,
        "Calibration that supplies the intrinsics (default: estimated from the same images of the "
        "board; wand and person: the session's calibration)");
    verb->add_flag("--refine-intrinsics", arguments->refine_intrinsics,
                   "Refine the intrinsics together with the extrinsics");
    verb->add_option("--board-on-floor-frame", arguments->board_on_floor_frame,
                     "Frame in which the board lies on the floor, print up: its lower left corner becomes "
                     "the origin, z up")
        ->check(CLI::NonNegativeNumber);
    verb->add_option("--stride", arguments->stride, "Use every Nth image")
        ->check(CLI::Range(1, 100000))
        ->capture_default_str();
    verb->add_flag("--k3", arguments->k3,
                   "Estimate a third radial distortion coefficient (very wide lenses)");
    return {{verb, [arguments] { return extrinsics(*arguments); }}};
}

}  // namespace kinevox::calibrate
