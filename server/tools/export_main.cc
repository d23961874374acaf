// kinevox-export: a processed trial in the format of another program.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <limits>
#include <string>

#include "common/atomic_file.h"
#include "common/degrees.h"
#include "server/recording/trial_formats.h"

namespace {


struct Arguments {
    std::filesystem::path folder, out;
    std::string format, frames;
    double turn_deg = 0;
    bool hold = false, quiet = false;
};

int fail(std::string message) {
    message = message.substr(0, message.find('\n'));
    fmt::print(stderr, "kinevox export: {}\n", message);
    return 1;
}

void declare(CLI::App& app, Arguments& arguments) {
    app.add_option("folder", arguments.folder, "What `kinevox process` wrote")->required();
    app.add_option("--format", arguments.format, "trc, mot (OpenSim), c3d, bvh or csv")
        ->required()
        ->check(CLI::IsMember({"trc", "mot", "c3d", "bvh", "csv"}));
    app.add_option("--out", arguments.out, "The file to write")->required();
    app.add_option("--frames", arguments.frames, "A part of the trial, FIRST-LAST, both included");
    app.add_option(
           "--turn", arguments.turn_deg,
           "Turns the trial about the vertical, degrees, anticlockwise from above: OpenSim's models look along x")
        ->check(CLI::Range(-360.0, 360.0));
    app.add_flag("--hold", arguments.hold, "bvh: where a value is withheld, repeat the last measured one");
    app.add_flag("--quiet", arguments.quiet, "Say nothing when all is well");
}

// "FIRST-LAST".
bool parse_frames(const std::string& text, std::int64_t& first, std::int64_t& last) {
    char rest = 0;
    long long a = 0, b = 0;
    if (std::sscanf(text.c_str(), "%15lld-%15lld%c", &a, &b, &rest) != 2 || a < 0 || b < a) return false;
    first = a, last = b;
    return true;
}

// OpenSim's models let the pelvis turn 90 deg to either side of x.
std::string clamped_remark(const kinevox::AngleRange& range, double turn_deg) {
    const double least = kinevox::degrees(range.least_rad), most = kinevox::degrees(range.most_rad);
    if (least >= -90 && most <= 90) return {};
    std::string remark = fmt::format(
        "; pelvis_rotation goes from {:.0f} to {:.0f} deg, but OpenSim's models clamp it at 90", least, most);
    if (most - least < 170)
        remark += fmt::format(": --turn {:.0f} avoids that", std::remainder(turn_deg - (least + most) / 2, 360.0));
    return remark;
}

absl::StatusOr<std::string> contents(const Arguments& arguments, const kinevox::Trial& trial, std::string& remark) {
    if (arguments.format == "trc") return kinevox::trc_file(trial, arguments.out.filename().string());
    if (arguments.format == "c3d") return kinevox::c3d_file(trial);
    if (arguments.format == "csv") return kinevox::csv_file(trial);
    if (arguments.format == "bvh") {
        std::int64_t held = 0;
        auto text = kinevox::bvh_file(trial, arguments.hold, &held);
        if (held > 0) remark = fmt::format("; {} frames repeat a value that was withheld", held);
        return text;
    }
    auto text = kinevox::mot_file(trial);
    if (text.ok()) remark = clamped_remark(kinevox::mot_pelvis_rotation(trial), arguments.turn_deg);
    return text;
}

int run(int argc, char** argv) {
    CLI::App app("Writes a processed trial as TRC or MOT (OpenSim), C3D, BVH or CSV.", "kinevox export");
    Arguments arguments;
    declare(app, arguments);
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        return fail(std::string(error.what()) + "; see kinevox export --help");
    }
    if (arguments.out.filename().empty()) return fail("--out is no file's name; give the file to write");
    auto trial = kinevox::read_trial(arguments.folder);
    if (!trial.ok()) return fail(std::string(trial.status().message()));
    if (!arguments.frames.empty()) {
        std::int64_t first = 0, last = 0;
        if (!parse_frames(arguments.frames, first, last))
            return fail(fmt::format("--frames is '{}'; write it as FIRST-LAST, for example 30-89", arguments.frames));
        trial = kinevox::part_of_trial(*trial, first, last);
        if (!trial.ok()) return fail(std::string(trial.status().message()));
    }
    if (arguments.turn_deg != 0) kinevox::turn_trial(*trial, kinevox::radians(arguments.turn_deg));
    std::string remark;
    const auto bytes = contents(arguments, *trial, remark);
    if (!bytes.ok()) return fail(std::string(bytes.status().message()));
    if (absl::Status written = kinevox::write_file_atomically(arguments.out, *bytes); !written.ok())
        return fail(std::string(written.message()));
    if (!arguments.quiet)
        fmt::print("{} frames at {:g} Hz in {}{}\n", trial->size(), trial->rate_hz, arguments.out.string(), remark);
    return 0;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return run(argc, argv);
    } catch (const std::exception& error) {
        return fail(error.what());
    }
}
