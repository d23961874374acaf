// kinevox-studio: writes a session of the virtual studio, with ground truth.
#include <absl/status/statusor.h>
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <string>

#include "server/calibration/board_detector.h"
#include "server/calibration/wand.h"
#include "server/cameras/studio/session_writer.h"
#include "server/cameras/studio/studio.h"

namespace {

int fail(const std::string& message) {
    fmt::print(stderr, "kinevox-studio: {}\n", message);
    return 1;
}

// "640x480"; false if it is not two numbers.
bool parse_size(const std::string& text, int& width, int& height) {
    char rest = 0;
    return std::sscanf(text.c_str(), "%5dx%5d%c", &width, &height, &rest) == 2;
}

// "charuco:6x5:160:120:DICT_4X4_100" or "wand:200:600", as `kinevox calibrate` reads them.
absl::Status set_prop(const std::string& text, int frames_on_floor, kinevox::studio::Staging& staging) {
    if (text.starts_with("wand:")) {
        const auto wand = kinevox::parse_wand(text);
        if (!wand.ok()) return wand.status();
        if (frames_on_floor > 0)
            return absl::InvalidArgumentError("--prop-on-floor is for boards; a wand is carried only");
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
    staged.middle_in_board = 0.5 * (points.front() + points.back());
    staged.frames_on_floor = frames_on_floor;
    staging.board = staged;
    return absl::OkStatus();
}

// "cam2:3.5:1": the second camera, at 3.5 s, by 1 degree.
bool parse_knock(const std::string& text, kinevox::studio::Staging& staging) {
    kinevox::studio::Knock knock;
    char rest = 0;
    int number = 0;
    if (std::sscanf(text.c_str(), "cam%4d:%lf:%lf%c", &number, &knock.time_s, &knock.turn_deg, &rest) != 3 ||
        number < 1)
        return false;
    knock.camera = static_cast<std::size_t>(number - 1);
    staging.knock = knock;
    return true;
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App app("Writes a session of the virtual studio: videos, backgrounds, calibration and ground truth.",
                 "kinevox-studio");
    kinevox::studio::StudioOptions studio_options;
    kinevox::studio::SessionWriterOptions writer_options;
    std::string size = "640x480", out, motion, prop, knock;
    int frames_on_floor = 0;
    bool no_masks = false;
    app.add_option("--motion", motion,
                   "walk, run, sprint_start, squat, jumping_jack or arm_raise; may be left out with --prop: "
                   "nobody is there");
    app.add_option(
        "--prop", prop,
        "carried through the space: charuco:6x5:160:120:DICT_4X4_100, checkerboard:6x5:120, "
        "aprilgrid:4x3:200:60 (mm), wand:200:600 (mm from the first ball) or wand:600 (two balls)");
    app.add_option("--prop-on-floor", frames_on_floor, "frames in which the board lies on the floor first")
        ->capture_default_str();
    app.add_option("--knock", knock,
                   "CAMERA:SECONDS:DEGREES, such as cam2:3.5:1: the camera is knocked then");
    app.add_option("--frames", writer_options.frames, "frame sets to write")->required();
    app.add_option("--out", out, "folder to write to; new or empty")->required();
    app.add_option("--cameras", studio_options.cameras, "cameras on the ring")->capture_default_str();
    app.add_option("--size", size, "of every picture, WIDTHxHEIGHT in px")->capture_default_str();
    app.add_option("--fps", studio_options.fps, "frame sets a second")->capture_default_str();
    app.add_option("--seed", studio_options.seed, "draws person, clothes, room, cameras and noise")
        ->capture_default_str();
    app.add_option("--subject-height", studio_options.subject_height_m, "m, 1.2 to 2.2; 0: drawn")
        ->capture_default_str();
    app.add_option("--stage", studio_options.stage, "room, lane, or auto: what suits the motion")
        ->capture_default_str();
    app.add_option("--noise", studio_options.noise_grey, "sensor noise, grey levels")->capture_default_str();
    app.add_option("--flicker", studio_options.flicker, "of the light, relative")->capture_default_str();
    app.add_option("--distortion", studio_options.distortion, "k1 of the lenses")->capture_default_str();
    app.add_option("--background-frames", writer_options.background_frames, "of the empty room")
        ->capture_default_str();
    app.add_option("--mesh-every", writer_options.mesh_every,
                   "write the true surface every so many frames; 0: never")
        ->capture_default_str();
    app.add_option("--quality", writer_options.quality, "of the videos: x264's crf, 0 is lossless")
        ->capture_default_str();
    app.add_flag("--no-masks", no_masks, "leave the true masks out");
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        return fail(fmt::format("{}; kinevox-studio --help lists the options", error.what()));
    }
    if (!parse_size(size, studio_options.width, studio_options.height))
        return fail(fmt::format("--size is '{}'; write it as WIDTHxHEIGHT, for example 640x480", size));
    studio_options.staging.person = !motion.empty();
    if (!motion.empty()) studio_options.motion = motion;
    if (motion.empty() && prop.empty())
        return fail("--motion is missing; give one, or --prop; kinevox-studio --help lists the options");
    if (!prop.empty())
        if (const absl::Status status = set_prop(prop, frames_on_floor, studio_options.staging); !status.ok())
            return fail(std::string(status.message()));
    if (prop.empty() && frames_on_floor > 0) return fail("--prop-on-floor needs a board; give --prop");
    if (!knock.empty() && !parse_knock(knock, studio_options.staging))
        return fail(fmt::format("--knock is '{}'; write it as cam2:3.5:1, camera, seconds, degrees", knock));
    writer_options.masks = !no_masks;
    if (const std::string wrong = writer_options.check(); !wrong.empty()) return fail(wrong);

    auto studio = kinevox::studio::Studio::create(studio_options);
    if (!studio.ok()) return fail(std::string(studio.status().message()));
    const bool terminal = isatty(STDERR_FILENO);
    if (terminal)
        writer_options.progress = [](std::int64_t done, std::int64_t all) {
            fmt::print(stderr, "\r{} of {} frame sets{}", done, all, done == all ? "\n" : "");
        };
    if (absl::Status status = kinevox::studio::write_session(**studio, out, writer_options); !status.ok()) {
        if (terminal) fmt::print(stderr, "\n");
        return fail(std::string(status.message()));
    }
    fmt::print("{}\nsession: {}\n", (*studio)->description(),
               (std::filesystem::path(out) / "session.toml").string());
    return 0;
}
