// World frame of cameras with known extrinsics.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <string>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/session_file.h"
#include "server/calibration/board/board_clips.h"
#include "server/calibration/board/floor.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/person_world.h"
#include "server/calibration/person/session_silhouettes.h"
#include "server/calibration/person/silhouette_hull.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/verbs.h"
#include "server/tools/console.h"

namespace kinevox::calibrate {
namespace {

constexpr double kStill_px = 3;  // a board whose corners move more is not at rest

struct FloorArguments {
    std::string input, calibration, board, points_file;
    std::vector<std::string> clips, points;
    double thickness_mm = 0, stature_m = 0;
    int frame = -1, frame_sets = 60;
    Output output;
};

struct Input {
    bool is_session = false;
    std::string calibration;  // the file with the cameras
    std::vector<Camera> cameras;
};

absl::StatusOr<Input> open_input(const FloorArguments& arguments) {
    Input input;
    input.calibration = arguments.input;
    if (arguments.input.ends_with(".toml")) {
        const auto text = read_file(arguments.input);
        if (!text.ok()) return text.status();
        input.is_session = text->find("[[camera]]") != std::string::npos;
    }
    if (input.is_session) {
        const auto session = read_session(arguments.input);
        if (!session.ok()) return session.status();
        input.calibration = session->calibration.string();
    }
    if (!arguments.calibration.empty()) input.calibration = arguments.calibration;
    auto cameras = read_calibration(input.calibration);
    if (!cameras.ok()) return cameras.status();
    input.cameras = *std::move(cameras);
    return input;
}

// Each camera's corners of the board on the floor, over all images or those of one frame.
absl::StatusOr<std::vector<std::vector<Corner>>> lying_board(const FloorArguments& arguments,
                                                             const Input& input, const BoardSpec& board,
                                                             const SolveProgress& progress) {
    const std::vector<std::string> files =
        arguments.clips.empty() && input.is_session ? std::vector{arguments.input} : arguments.clips;
    if (files.empty())
        return absl::InvalidArgumentError(
            "no images of the board on the floor; give --videos NAME=FILE per camera, or a session");
    const auto clips = open_clips(files);
    if (!clips.ok()) return clips.status();
    const auto detections = detect_boards(
        *clips, board, arguments.frame < 0 ? ClipImages{} : ClipImages{arguments.frame, 1, 1}, progress);
    if (!detections.ok()) return detections.status();
    std::vector<std::vector<Corner>> seen(input.cameras.size());
    for (std::size_t k = 0; k < clips->size(); ++k) {
        const CameraClip& clip = (*clips)[k];
        const Camera* const camera = camera_named(input.cameras, clip.camera);
        if (!camera || camera->width != clip.width || camera->height != clip.height)
            return absl::InvalidArgumentError(
                fmt::format("{}: has no camera {} of {} x {} px; name the video as its camera, NAME=FILE",
                            input.calibration, clip.camera, clip.width, clip.height));
        std::vector<Corner>& corners = seen[camera - input.cameras.data()];
        std::map<int, Vec2> first;
        for (const BoardDetection& detection : (*detections)[k]) {
            for (const Corner& corner : detection.corners) {
                const auto [known, added] = first.emplace(corner.id, corner.pixel);
                if (std::hypot(known->second.x - corner.pixel.x, known->second.y - corner.pixel.y) >
                    kStill_px)
                    return absl::InvalidArgumentError(
                        fmt::format("camera {}: the board moves in these images; give "
                                    "--board-on-floor-frame, one in which it lies on the floor",
                                    clip.camera));
                corners.push_back(corner);
            }
        }
        arguments.output.print("{:12} {} corners of the board\n", clip.camera, first.size());
    }
    return seen;
}

void print_floor(const FloorResult& floor, const Output& output) {
    if (floor.rms_px) output.print("reprojection error {:.2f} px\n", *floor.rms_px);
    if (floor.flatness_rms_mm)
        output.print("{} floor points, flat to {:.0f} mm\n", floor.on_floor.size(), *floor.flatness_rms_mm);
    if (floor.tilt_std_deg)
        output.print("standard deviation of the tilt {:.2f} degrees\n", *floor.tilt_std_deg);
}

// Findings about an earlier floor.
bool is_about_the_floor(const Finding& finding) {
    for (const char* check :
         {"target_mirrored", "camera_below_floor", "camera_upside_down", "subject_not_upright", "feet_height",
          "world_inherited", "single_view", "ambiguous_floor", "clicked_points", "floor_flatness",
          "board_on_floor", "walk_too_narrow", "floor_contacts"})
        if (finding.check == check) return true;
    return false;
}

// The cameras' certificate, if any, moved to the new world frame.
Certificate with_floor(const Input& input, const FloorResult& floor) {
    Certificate certificate =
        certificate_next_to(input.calibration, input.cameras).value_or(Certificate{.method = "floor"});
    certificate.create_time.clear();
    certificate.cameras = input.cameras;
    move_cameras({1, floor.world_from_old}, certificate.cameras);
    for (Vec3& point : certificate.target_points) point = floor.world_from_old * point;
    const std::vector<Vec3>& space =
        certificate.target_points.empty() ? floor.on_floor : certificate.target_points;
    certificate.volume = working_volume(certificate.cameras, space);
    certificate.world_defined = true;
    certificate.floor = FloorQuality{floor.method, floor.rms_px, floor.flatness_rms_mm, floor.tilt_std_deg};
    std::erase_if(certificate.findings, is_about_the_floor);
    certificate.findings.insert(certificate.findings.end(), floor.findings.begin(), floor.findings.end());
    return certificate;
}

absl::Status define_floor(const FloorArguments& arguments) {
    if (absl::Status free = check_output(arguments.output); !free.ok()) return free;
    const bool by_points = !arguments.points.empty() || !arguments.points_file.empty();
    if (by_points && !arguments.board.empty())
        return absl::InvalidArgumentError(
            "board and points given; use one of --board, --point, --points-file");
    const auto input = open_input(arguments);
    if (!input.ok()) return input.status();
    if (!by_points && arguments.board.empty() && !input->is_session)
        return absl::InvalidArgumentError(fmt::format(
            "{}: is a calibration; give --board or --point too, or a session with a walking person",
            arguments.input));
    const SolveProgress progress = console_progress(arguments.output.quiet);
    absl::StatusOr<FloorResult> floor;
    std::optional<SessionSilhouettes> person;
    if (by_points) {
        std::vector<FloorPoint> points;
        for (const std::string& text : arguments.points) {
            auto point = parse_floor_point(text, input->cameras);
            if (!point.ok()) return point.status();
            points.push_back(*std::move(point));
        }
        if (!arguments.points_file.empty()) {
            auto more = read_floor_points(arguments.points_file, input->cameras);
            if (!more.ok()) return more.status();
            points.insert(points.end(), more->begin(), more->end());
        }
        floor = floor_from_points(input->cameras, points);
    } else if (!arguments.board.empty()) {
        const auto board = parse_board(arguments.board);
        if (!board.ok()) return board.status();
        const auto seen = lying_board(arguments, *input, *board, progress);
        if (!seen.ok()) return seen.status();
        floor = floor_from_board(input->cameras, board->points(), *seen, arguments.thickness_mm / 1000);
    } else {
        auto seen = session_silhouettes(arguments.input, arguments.frame_sets, input->calibration, progress);
        if (!seen.ok()) return seen.status();
        for (Camera& camera : seen->cameras) {
            const Camera* const found = camera_named(input->cameras, camera.name);
            if (!found)
                return absl::InvalidArgumentError(
                    fmt::format("{}: has no camera {}", input->calibration, camera.name));
            camera = *found;
        }
        person = *std::move(seen);
        floor = floor_from_person(person->cameras, person->set, {}, progress);
    }
    if (!floor.ok()) return floor.status();
    print_floor(*floor, arguments.output);

    Certificate certificate = with_floor(*input, *floor);
    std::optional<SubjectExtent> extent;
    if (person) {
        move_cameras({1, floor->world_from_old}, person->cameras);
        extent = subject_extent(person->cameras, person->set);
        // The floor is under the feet by definition, and the hull gives the better height.
        if (extent && floor->stature_m) extent->lowest_m = 0, extent->highest_m = *floor->stature_m;
        certificate.stature_m = floor->stature_m;
        certificate.hull_iou = hull_iou(person->cameras, person->set);
        certificate.overlays = silhouette_overlays(person->cameras, person->set);
    }
    const std::optional<double> height =
        arguments.stature_m > 0 ? std::optional(arguments.stature_m) : std::nullopt;
    for (Finding& finding : check_world(certificate.cameras, extent, height))
        certificate.findings.push_back(std::move(finding));
    return write_calibration(certificate, arguments.output);
}

}  // namespace

std::vector<Verb> floor_verbs(CLI::App& app) {
    const auto arguments = std::make_shared<FloorArguments>();
    CLI::App* const verb = app.add_subcommand(
        "floor", "Define the world frame from a board on the floor, clicked points or a walking person");
    verb->add_option(
            "input", arguments->input,
            "Session, or calibration with extrinsics. Without --board and --point the floor is fitted to "
            "the feet of the person who walks in the session")
        ->required();
    verb->add_option("--calibration", arguments->calibration, "Calibration (default: the session's)");
    verb->add_option("--board", arguments->board, std::string("Board on the floor, print up: ") + kBoardHelp);
    verb->add_option("--videos", arguments->clips,
                     "NAME=FILE per camera, images or videos of that board (default: the session's)");
    verb->add_option("--board-on-floor-frame", arguments->frame,
                     "Frame in which the board lies on the floor, from 0 (default: all)")
        ->check(CLI::NonNegativeNumber);
    verb->add_option("--board-thickness", arguments->thickness_mm, "Board thickness (mm)")
        ->check(CLI::Range(0.0, 200.0))
        ->capture_default_str();
    verb->add_option(
        "--point", arguments->points,
        "'0,0,0 cam1:412.5,300 cam3:99,120': world coordinates (m) of a point and where it was "
        "clicked (px); three or more. Without coordinates the points lie on the floor, the first is "
        "the origin, the second gives the x direction");
    verb->add_option("--points-file", arguments->points_file, "File with one such point per line");
    verb->add_option("--stature", arguments->stature_m, "Subject's height (m, with shoes); checks the scale")
        ->check(CLI::Range(0.5, 2.6));
    verb->add_option("--frame-sets", arguments->frame_sets, "Number of frame sets of the person to use")
        ->check(CLI::Range(10, 500))
        ->capture_default_str();
    declare_output(*verb, arguments->output);
    return {{verb, [arguments] { return define_floor(*arguments); }}};
}

}  // namespace kinevox::calibrate
