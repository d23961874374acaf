// kinevox-studio: renders a session of the virtual studio, with ground truth.
#include <absl/status/statusor.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "common/command_line.h"
#include "common/progress_line.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/wand/wand.h"
#include "server/cameras/studio/motion.h"
#include "server/cameras/studio/scene_file.h"
#include "server/cameras/studio/session_writer.h"
#include "server/cameras/studio/studio.h"

namespace {

struct Arguments {
    kinevox::studio::StudioOptions studio;
    kinevox::studio::SessionWriterOptions writer;
    std::string size = "640x480", out, motion, target, bump, scene;
    int board_on_floor_frames = 0;
    bool no_masks = false, json = false;
};

// "640x480"; false if it is not two numbers.
bool parse_size(const std::string& text, int& width, int& height) {
    char rest = 0;
    return std::sscanf(text.c_str(), "%5dx%5d%c", &width, &height, &rest) == 2;
}

// "charuco:6x5:160:120:DICT_4X4_100" or "wand:200:600", as `kinevox calibrate` reads them.
absl::Status set_target(const std::string& text, int frames_on_floor, kinevox::studio::Staging& staging) {
    if (text.starts_with("wand:")) {
        const auto wand = kinevox::parse_wand(text);
        if (!wand.ok()) return wand.status();
        if (frames_on_floor > 0)
            return absl::InvalidArgumentError("--board-on-floor-frames needs a board; --target is a wand");
        kinevox::studio::StagedWand staged;
        for (const kinevox::Vec3 ball : wand->balls()) staged.along_m.push_back(ball.x);
        staging.wand = staged;
        return absl::OkStatus();
    }
    const auto board = kinevox::parse_board(text);
    if (!board.ok()) return board.status();
    const auto detector = kinevox::BoardDetector::create(*board);
    if (!detector.ok()) return detector.status();
    kinevox::studio::StagedBoard staged;
    staged.print.grey = (*detector)->draw(staged.print.pixels_per_m, staged.print.origin_px);
    const auto points = board->points();
    staged.centre_in_board = 0.5 * (points.front() + points.back());
    staged.frames_on_floor = frames_on_floor;
    staging.board = staged;
    return absl::OkStatus();
}

// "cam2:3.5:1": the second camera, at 3.5 s, by 1 degree.
bool parse_bump(const std::string& text, kinevox::studio::Staging& staging) {
    kinevox::studio::CameraBump bump;
    char rest = 0;
    int number = 0;
    if (std::sscanf(text.c_str(), "cam%4d:%lf:%lf%c", &number, &bump.time_s, &bump.rotation_deg, &rest) !=
            3 ||
        number < 1)
        return false;
    bump.camera = static_cast<std::size_t>(number - 1);
    staging.bump = bump;
    return true;
}

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("--motion", arguments.motion,
                   fmt::format("Motion of the person: {} (with --target optional: no person)",
                               fmt::join(kinevox::studio::kMotionNames, ", ")));
    app.add_option(
        "--target", arguments.target,
        "Target carried through the space: charuco:6x5:160:120:DICT_4X4_100, checkerboard:6x5:120, "
        "aprilgrid:4x3:200:60 (mm), wand:200:600 (mm from the first ball) or wand:600 (two balls)");
    app.add_option("--board-on-floor-frames", arguments.board_on_floor_frames,
                   "Number of first frames in which the board lies on the floor")
        ->capture_default_str();
    app.add_option("--bump", arguments.bump, "Bump a camera: CAMERA:SECONDS:DEGREES, for example cam2:3.5:1");
    app.add_option("--scene", arguments.scene,
                   "Scene file: person, clothes, room, light, cameras and motion; only --out, --mesh-stride, "
                   "--no-masks and --json may be given with it");
    app.add_option("--frames", arguments.writer.frames, "Number of frame sets (required without --scene)");
    app.add_option("--out", arguments.out, "Output folder (new or empty)")->required();
    app.add_option("--cameras", arguments.studio.cameras, "Number of cameras on the ring")
        ->capture_default_str();
    app.add_option("--size", arguments.size, "Image size, WIDTHxHEIGHT (px)")->capture_default_str();
    app.add_option("--fps", arguments.studio.fps, "Frame sets per second")->capture_default_str();
    app.add_option("--seed", arguments.studio.seed, "Random seed (person, clothes, room, cameras, noise)")
        ->capture_default_str();
    app.add_option("--stature", arguments.studio.stature_m,
                   "Stature of the person (m, 1.2 to 2.2; 0: random)")
        ->capture_default_str();
    app.add_option("--stage", arguments.studio.stage, "Stage: room, lane, or auto (suits the motion)")
        ->capture_default_str();
    app.add_option("--noise", arguments.studio.noise_grey, "Sensor noise (grey levels)")
        ->capture_default_str();
    app.add_option("--flicker", arguments.studio.flicker, "Relative flicker of the light")
        ->capture_default_str();
    app.add_option("--distortion", arguments.studio.distortion, "Radial distortion k1 of the cameras")
        ->capture_default_str();
    app.add_option("--background-frames", arguments.writer.background_frames, "Background frames")
        ->capture_default_str();
    app.add_option("--mesh-stride", arguments.writer.mesh_stride,
                   "Write the true surface every Nth frame (0: never)")
        ->capture_default_str();
    app.add_option("--crf", arguments.writer.crf, "Video quality: x264's CRF (0: lossless)")
        ->capture_default_str();
    app.add_flag("--no-masks", arguments.no_masks, "Omit ground-truth masks");
    app.add_flag("--json", arguments.json, "Print one JSON object");
}

// The options that are given as text.
absl::Status read_arguments(const CLI::App& app, Arguments& arguments) {
    const auto wrong = [](const std::string& message) { return absl::InvalidArgumentError(message); };
    if (!parse_size(arguments.size, arguments.studio.width, arguments.studio.height))
        return wrong(
            fmt::format("--size is '{}'; it must be WIDTHxHEIGHT, for example 640x480", arguments.size));
    if (app.count("--frames") == 0) return wrong("--frames is missing; give it, or --scene");
    arguments.studio.staging.person = !arguments.motion.empty();
    if (!arguments.motion.empty()) arguments.studio.motion = arguments.motion;
    if (arguments.motion.empty() && arguments.target.empty())
        return wrong("--motion is missing; give --motion or --target; see kinevox studio --help");
    if (arguments.target.empty() && arguments.board_on_floor_frames > 0)
        return wrong("--board-on-floor-frames needs a board; give --target");
    if (!arguments.bump.empty() && !parse_bump(arguments.bump, arguments.studio.staging))
        return wrong(fmt::format("--bump is '{}'; it must be CAMERA:SECONDS:DEGREES, for example cam2:3.5:1",
                                 arguments.bump));
    arguments.writer.masks = !arguments.no_masks;
    if (const std::string problem = arguments.writer.check(); !problem.empty()) return wrong(problem);
    return arguments.target.empty()
               ? absl::OkStatus()
               : set_target(arguments.target, arguments.board_on_floor_frames, arguments.studio.staging);
}

// Everything comes from the scene file, but for what concerns the output alone.
absl::Status read_scene_arguments(const CLI::App& app, Arguments& arguments) {
    for (const CLI::Option* option : app.get_options()) {
        const std::string name = option->get_name();
        if (option->count() > 0 && name != "--scene" && name != "--out" && name != "--mesh-stride" &&
            name != "--no-masks" && name != "--json")
            return absl::InvalidArgumentError(
                fmt::format("{} is given with --scene; set it in {}", name, arguments.scene));
    }
    auto scene = kinevox::studio::read_scene(arguments.scene);
    if (!scene.ok()) return scene.status();
    const int mesh_stride = arguments.writer.mesh_stride;
    arguments.studio = std::move(scene->studio);
    arguments.writer = std::move(scene->writer);
    arguments.writer.mesh_stride = mesh_stride;
    arguments.writer.masks = !arguments.no_masks;
    if (const std::string problem = arguments.writer.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    return absl::OkStatus();
}

absl::Status run(const CLI::App& app, Arguments& arguments) {
    if (absl::Status read =
            arguments.scene.empty() ? read_arguments(app, arguments) : read_scene_arguments(app, arguments);
        !read.ok())
        return read;
    auto studio = kinevox::studio::Studio::create(arguments.studio);
    if (!studio.ok()) return studio.status();
    kinevox::ProgressLine line(arguments.json);
    arguments.writer.progress = [&line](std::int64_t done, std::int64_t all) {
        if (line.due()) line.draw(fmt::format("{} of {} frame sets", done, all));
    };
    const absl::Status written = kinevox::studio::write_session(**studio, arguments.out, arguments.writer);
    line.clear();
    if (!written.ok()) return written;
    const std::string session = (std::filesystem::path(arguments.out) / "session.toml").string();
    if (arguments.json)
        fmt::print(
            "{}\n",
            nlohmann::ordered_json({{"description", (*studio)->description()}, {"session", session}}).dump());
    else
        fmt::print("{}\nsession: {}\n", (*studio)->description(), session);
    return absl::OkStatus();
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App app("Render a session of the virtual studio: videos, backgrounds, calibration and ground truth.",
                 "kinevox studio");
    Arguments arguments;
    declare(app, arguments);
    return kinevox::tool_main(app, argc, argv, [&] { return run(app, arguments); });
}
