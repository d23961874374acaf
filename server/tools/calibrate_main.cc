// kinevox-calibrate: calibration on files, no daemon.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "common/one_line.h"
#include "server/cameras/session_source.h"
#include "server/tools/calibrate/verbs.h"

namespace {

int fail(const std::string& message) {
    fmt::print(stderr, "kinevox calibrate: {}\n", kinevox::one_line(message));
    return 1;
}

int run(int argc, char** argv) {
    CLI::App app("Cameras: intrinsics, places in the room, floor, and whether the result can be trusted.",
                 "kinevox calibrate");
    app.require_subcommand(1);
    std::vector<kinevox::calibrate::Verb> verbs = kinevox::calibrate::file_verbs(app);
    for (const auto& more : {kinevox::calibrate::lens_verbs(app), kinevox::calibrate::places_verbs(app),
                             kinevox::calibrate::floor_verbs(app), kinevox::calibrate::session_verbs(app)})
        verbs.insert(verbs.end(), more.begin(), more.end());
    try {
        app.parse(argc, argv);
    } catch (const CLI::CallForHelp& help) {
        return app.exit(help);
    } catch (const CLI::ParseError& error) {
        const std::string text = error.what();
        return fail(text.substr(0, text.find('\n')) + "; see kinevox calibrate --help");
    }
    kinevox::silence_video_libraries();
    for (const kinevox::calibrate::Verb& verb : verbs) {
        if (!verb.app->parsed()) continue;
        const absl::Status status = verb.run();
        return status.ok() ? 0 : fail(std::string(status.message()));
    }
    return 1;
}

}  // namespace

int main(int argc, char** argv) {
    try {
        return run(argc, argv);
    } catch (const std::exception& error) {
        return fail(error.what());
    }
}
