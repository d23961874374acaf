#include <CLI/CLI.hpp>

#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct ControlOptions {
    std::string name = default_operator_name();
    int frames = 0;
};

absl::Status report(const Common& common, const absl::Status& status, const std::string& done) {
    if (status.ok()) print_line(common.json ? "{\"done\":\"" + done + "\"}" : done);
    return status;
}

void add_name(CLI::App& verb, ControlOptions& options) {
    verb.add_option("--name", options.name, "Under which name control is taken")->capture_default_str();
}

}  // namespace

void add_control_verbs(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<ControlOptions>();

    CLI::App* start = app.add_subcommand("start", "Start capturing (takes control for the moment)");
    add_common_options(*start, common);
    add_name(*start, *options);
    start->callback([&, options] {
        run = [&common, options] {
            return report(common, client::Client(common.client_options()).start(options->name), "started");
        };
    });

    CLI::App* stop = app.add_subcommand("stop", "Stop capturing (takes control for the moment)");
    add_common_options(*stop, common);
    add_name(*stop, *options);
    stop->callback([&, options] {
        run = [&common, options] {
            return report(common, client::Client(common.client_options()).stop(options->name), "stopped");
        };
    });

    CLI::App* learn =
        app.add_subcommand("learn-background", "Learn the empty scene anew (takes control for the moment)");
    add_common_options(*learn, common);
    add_name(*learn, *options);
    learn
        ->add_option(
            "--frames", options->frames,
            "Live frame sets to learn from, nobody in the scene; 0: the source's own clip, capture stopped")
        ->check(CLI::Range(0, 1000))
        ->capture_default_str();
    learn->callback([&, options] {
        run = [&common, options] {
            // Learning takes as long as its frames last; ten a second is slow for a camera.
            const std::chrono::milliseconds timeout = common.client_options().timeout +
                                                      std::chrono::seconds(20) +
                                                      options->frames * std::chrono::milliseconds(100);
            return report(common,
                          client::Client(common.client_options())
                              .learn_background(options->name, options->frames, timeout),
                          "learned");
        };
    });
}

}  // namespace kinevox::cli
