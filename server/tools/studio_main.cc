// kinevox-studio: writes a session of the virtual studio, with ground truth.
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <string>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

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

}  // namespace

int main(int argc, char** argv) {
    CLI::App app("Writes a session of the virtual studio: videos, backgrounds, calibration and ground truth.", "kinevox-studio");
    kinevox::studio::StudioOptions studio_options;
    kinevox::studio::SessionWriterOptions writer_options;
    std::string size = "640x480", out;
    bool no_masks = false;
    app.add_option("--motion", studio_options.motion, "walk, run, sprint_start, squat, jumping_jack or arm_raise")->required();
    app.add_option("--frames", writer_options.frames, "frame sets to write")->required();
    app.add_option("--out", out, "folder to write to; new or empty")->required();
    app.add_option("--cameras", studio_options.cameras, "cameras on the ring")->capture_default_str();
    app.add_option("--size", size, "of every picture, WIDTHxHEIGHT in px")->capture_default_str();
    app.add_option("--fps", studio_options.fps, "frame sets a second")->capture_default_str();
    app.add_option("--seed", studio_options.seed, "draws person, clothes, room, cameras and noise")->capture_default_str();
    app.add_option("--subject-height", studio_options.subject_height_m, "m, 1.2 to 2.2; 0: drawn")->capture_default_str();
    app.add_option("--stage", studio_options.stage, "room, lane, or auto: what suits the motion")->capture_default_str();
    app.add_option("--noise", studio_options.noise_grey, "sensor noise, grey levels")->capture_default_str();
    app.add_option("--flicker", studio_options.flicker, "of the light, relative")->capture_default_str();
    app.add_option("--distortion", studio_options.distortion, "k1 of the lenses")->capture_default_str();
    app.add_option("--background-frames", writer_options.background_frames, "of the empty room")->capture_default_str();
    app.add_option("--mesh-every", writer_options.mesh_every, "write the true surface every so many frames; 0: never")->capture_default_str();
    app.add_option("--quality", writer_options.quality, "of the videos: x264's crf, 0 is lossless")->capture_default_str();
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
    fmt::print("{}\nsession: {}\n", (*studio)->description(), (std::filesystem::path(out) / "session.toml").string());
    return 0;
}
