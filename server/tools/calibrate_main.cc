// kinevox-calibrate: calibration on files, without a daemon.
#include <CLI/CLI.hpp>
#include <vector>

#include "common/command_line.h"
#include "server/cameras/session_source.h"
#include "server/tools/calibrate/verbs.h"

int main(int argc, char** argv) {
    using namespace kinevox::calibrate;
    CLI::App app("Camera calibration on files: intrinsics, extrinsics, world frame and their quality.",
                 "kinevox calibrate");
    app.require_subcommand(1);
    std::vector<Verb> verbs;
    for (const auto& more : {intrinsics_verbs(app), extrinsics_verbs(app), floor_verbs(app),
                             session_verbs(app), convert_verbs(app)})
        verbs.insert(verbs.end(), more.begin(), more.end());
    return kinevox::tool_main(app, argc, argv, [&] {
        kinevox::silence_video_libraries();
        for (const Verb& verb : verbs)
            if (verb.app->parsed()) return verb.run();
        return absl::OkStatus();
    });
}
