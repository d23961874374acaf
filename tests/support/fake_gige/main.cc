// kinevox-fake-gige: a GigE Vision camera for the tests. Prints "ready ADDRESS"; on SIGTERM it vanishes and
// prints what it sent as a line of JSON.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>

#include "tests/support/fake_gige/fake_camera.h"

namespace {

std::atomic<bool> stop = false;  // a signal handler's only way

}  // namespace

int main(int argc, char** argv) {
    using namespace kinevox::testing;
    FakeCameraOptions options;
    std::string session, camera;
    std::size_t images = 90;
    CLI::App app("A GigE Vision camera for the tests", "kinevox-fake-gige");
    app.add_option("--address", options.address, "of this machine, port 3956");
    app.add_option("--serial", options.serial);
    app.add_option("--name", options.name, "the user's name for it");
    app.add_option("--session", session, "session.toml whose images it shows; none: a test pattern");
    app.add_option("--camera", camera, "of the session");
    app.add_option("--images", images, "of the session, then from the first again");
    app.add_option("--empty-while", options.empty_while, "the empty scene while this file exists");
    app.add_option("--external-fps", options.external_fps, "pulses a second on Line1");
    app.add_option("--phase-ms", options.phase_ms, "behind the pulse, or the start");
    app.add_option("--clock-offset-s", options.clock_offset_s);
    app.add_option("--clock-drift-ppm", options.clock_drift_ppm);
    app.add_option("--first-block", options.first_block, "number of the first image");
    app.add_option("--loss", options.network.loss, "part of the packets, 0..1");
    app.add_option("--lost-images", options.network.lost_images,
                   "part of the images of which nothing arrives");
    app.add_option("--jitter-ms", options.network.jitter_ms, "of an image");
    app.add_option("--reorder-ms", options.network.reorder_ms, "of each packet");
    app.add_option("--seed", options.network.seed);
    CLI11_PARSE(app, argc, argv);

    Scene scene;
    if (!session.empty()) {
        auto opened = Scene::open(session, camera, images);
        if (!opened.ok())
            return fmt::print(stderr, "kinevox-fake-gige: {}\n", std::string(opened.status().message())), 1;
        scene = *std::move(opened);
    }
    std::signal(SIGTERM, [](int) { stop = true; });
    std::signal(SIGINT, [](int) { stop = true; });
    FakeCamera fake(options, std::move(scene));
    if (const auto status = fake.listen(); !status.ok())
        return fmt::print(stderr, "kinevox-fake-gige: {}\n", std::string(status.message())), 1;
    fmt::print("ready {}\n", options.address);
    std::fflush(stdout);
    fake.run(stop);
    const NetworkCounts& counts = fake.counts();
    fmt::print(
        "{{\"taken\": {}, \"gone\": {}, \"packets\": {}, \"packets_lost\": {}, \"resent\": {}, "
        "\"under_way\": {}}}\n",
        fake.images_taken(), counts.images_gone, counts.packets, counts.packets_lost, counts.resent,
        counts.under_way);
    return 0;
}
