// Floor and origin of cameras that have places already.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <memory>
#include <string>

#include "common/atomic_file.h"
#include "common/calibration_file.h"
#include "common/session_file.h"
#include "server/calibration/agreement_pictures.h"
#include "server/calibration/board_clips.h"
#include "server/calibration/diagnosis.h"
#include "server/calibration/floor.h"
#include "server/calibration/floor_points.h"
#include "server/calibration/hull_agreement.h"
#include "server/calibration/session_silhouettes.h"
#include "server/calibration/triangulation.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

constexpr double kStill_px = 3;  // a board whose corners move by more does not lie

struct FloorArguments {
    std::string input, calibration, board, points_file, out;
    std::vector<std::string> clips, points;
    double thickness_mm = 0, height_m = 0;
    int frame = -1, moments = 60;
    bool quiet = false;
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

// Each camera's corners of the board that lies on the floor, over all pictures or those of one frame.
absl::StatusOr<std::vector<std::vector<Corner>>> lying_board(const FloorArguments& arguments,
                                                             const Input& input, const BoardSpec& board,
                                                             const SolveProgress& progress) {
    const std::vector<std::string> files =
        arguments.clips.empty() && input.is_session ? std::vector{arguments.input} : arguments.clips;
    if (files.empty())
        return absl::InvalidArgumentError(
            "which pictures show the board on the floor? Give --clips NAME=FILE for each camera, or a "
            "session");
    const auto clips = open_clips(files);
    if (!clips.ok()) return clips.status();
    const auto sightings = find_boards(
        *clips, board, arguments.frame < 0 ? ClipPictures{} : ClipPictures{arguments.frame, 1, 1}, progress);
    if (!sightings.ok()) return sightings.status();
    std::vector<std::vector<Corner>> seen(input.cameras.size());
    for (std::size_t k = 0; k < clips->size(); ++k) {
        const CameraClip& clip = (*clips)[k];
        const Camera* const camera = camera_named(input.cameras, clip.camera);
        if (!camera || camera->width != clip.width || camera->height != clip.height)
            return absl::InvalidArgumentError(
                fmt::format("{}: has no camera {} of {} x {} px; name the clip as its camera, NAME=FILE",
                            input.calibration, clip.camera, clip.width, clip.height));
        std::vector<Corner>& corners = seen[camera - input.cameras.data()];
        std::map<int, Vec2> first;
        for (const BoardSighting& sighting : (*sightings)[k]) {
            for (const Corner& corner : sighting.corners) {
                const auto [known, added] = first.emplace(corner.id, corner.pixel);
                if (std::hypot(known->second.x - corner.pixel.x, known->second.y - corner.pixel.y) >
                    kStill_px)
                    return absl::InvalidArgumentError(fmt::format(
                        "camera {}: the board moves in these pictures; give --frame, one in which it lies on "
                        "the floor",
                        clip.camera));
                corners.push_back(corner);
            }
        }
        fmt::print("{:12} {} corners of the board\n", clip.camera, first.size());
    }
    return seen;
}

void print_floor(const FloorResult& floor) {
    if (floor.rms_px) fmt::print("misses by {:.2f} px\n", *floor.rms_px);
    if (floor.flat_rms_mm)
        fmt::print("{} points of the floor, even to {:.0f} mm\n", floor.on_floor.size(), *floor.flat_rms_mm);
    if (floor.tilt_std_deg) fmt::print("tilt known to {:.2f} degrees\n", *floor.tilt_std_deg);
}

// What a finding says about a floor that was set before.
bool is_about_the_floor(const Finding& finding) {
    for (const char* check :
         {"mirrored", "below_floor", "upside_down", "not_upright", "floor", "world", "one_view", "ambiguous",
          "clicks", "flat_floor", "board_on_floor", "floor_narrow", "floor_contacts"})
        if (finding.check == check) return true;
    return false;
}

// The certificate that the cameras have, if any, moved to the new world.
Certificate with_floor(const Input& input, const FloorResult& floor) {
    Certificate certificate =
        certificate_beside(input.calibration, input.cameras).value_or(Certificate{.made_by = "floor"});
    certificate.made_at.clear();
    certificate.cameras = input.cameras;
    move_cameras({1, floor.world_from_old}, certificate.cameras);
    for (Vec3& point : certificate.seen_points) point = floor.world_from_old * point;
    const std::vector<Vec3>& space =
        certificate.seen_points.empty() ? floor.on_floor : certificate.seen_points;
    certificate.volume = working_volume(certificate.cameras, space);
    certificate.world_is_set = true;
    certificate.floor = FloorQuality{floor.made_by, floor.rms_px, floor.flat_rms_mm, floor.tilt_std_deg};
    std::erase_if(certificate.findings, is_about_the_floor);
    certificate.findings.insert(certificate.findings.end(), floor.findings.begin(), floor.findings.end());
    return certificate;
}

absl::Status set_floor(const FloorArguments& arguments) {
    const bool by_points = !arguments.points.empty() || !arguments.points_file.empty();
    if (by_points && !arguments.board.empty())
        return absl::InvalidArgumentError("a board or points? Give one of --board, --point and --points");
    const auto input = open_input(arguments);
    if (!input.ok()) return input.status();
    if (!by_points && arguments.board.empty() && !input->is_session)
        return absl::InvalidArgumentError(fmt::format(
            "{}: is a calibration; give --board or --point too, or a session in which a person walks",
            arguments.input));
    const SolveProgress progress = console_progress(arguments.quiet);
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
        auto seen = session_silhouettes(arguments.input, arguments.moments, input->calibration, progress);
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
    print_floor(*floor);

    Certificate certificate = with_floor(*input, *floor);
    std::optional<SubjectExtent> extent;
    if (person) {
        move_cameras({1, floor->world_from_old}, person->cameras);
        extent = subject_extent(person->cameras, person->set);
        // The floor is under the feet already, and the hull knows better how tall the person is.
        if (extent && floor->subject_height_m)
            extent->lowest_m = 0, extent->highest_m = *floor->subject_height_m;
        certificate.subject_height_m = floor->subject_height_m;
        certificate.hull = hull_agreement(person->cameras, person->set);
        certificate.pictures = agreement_pictures(person->cameras, person->set);
    }
    const std::optional<double> height =
        arguments.height_m > 0 ? std::optional(arguments.height_m) : std::nullopt;
    for (Finding& finding : check_world(certificate.cameras, extent, height))
        certificate.findings.push_back(std::move(finding));
    return write_calibration(certificate, arguments.out);
}

}  // namespace

std::vector<Verb> floor_verbs(CLI::App& app) {
    const auto floor = std::make_shared<FloorArguments>();
    CLI::App* const verb = app.add_subcommand("floor",
                                              "Floor, origin and directions of the world: from a board on "
                                              "the floor, from clicked points, or from a "
                                              "person who walks");
    verb->add_option(
            "input", floor->input,
            "A session, or a calibration whose cameras have places. Without --board and --point the floor is "
            "taken from the feet of the person who walks in the session")
        ->required();
    verb->add_option("--calibration", floor->calibration, "Instead of the session's own");
    verb->add_option("--board", floor->board,
                     std::string("A board lies on the floor, print up: ") + kBoardHelp);
    verb->add_option("--clips", floor->clips,
                     "NAME=FILE, pictures or videos of that board; without it the session's");
    verb->add_option("--frame", floor->frame, "The picture in which it lies there, from 0; without it all")
        ->check(CLI::NonNegativeNumber);
    verb->add_option("--board-thickness", floor->thickness_mm, "mm: the floor is so much under the print")
        ->check(CLI::Range(0.0, 200.0))
        ->capture_default_str();
    verb->add_option(
        "--point", floor->points,
        "'0,0,0 cam1:412.5,300 cam3:99,120': a point's world coordinates in m and where it was clicked, px; "
        "three or more. Without coordinates they lie on the floor, the first is the origin, the second gives "
        "the x direction");
    verb->add_option("--points", floor->points_file, "A file with such a point in each line");
    verb->add_option("--subject-height", floor->height_m, "m, as measured: checks the scale")
        ->check(CLI::Range(0.5, 2.6));
    verb->add_option("--moments", floor->moments, "Frame sets of the person to look at")
        ->check(CLI::Range(10, 500))
        ->capture_default_str();
    verb->add_option("--out", floor->out, "The calibration to write, .toml; its certificate goes beside it")
        ->required();
    verb->add_flag("--quiet", floor->quiet, "No progress");
    return {{verb, [floor] { return set_floor(*floor); }}};
}

}  // namespace kinevox::calibrate
