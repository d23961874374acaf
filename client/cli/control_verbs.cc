// `kinevox start`, `stop` and `learn-background`.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "client/cli/verbs.h"
#include "common/progress_line.h"

namespace kinevox::cli {
namespace {

struct ControlOptions {
    std::string operator_name = default_operator_name();
    int frames = 0;
    bool force = false, restore = false;
};

absl::Status report(const GlobalOptions& global, const absl::Status& status, const std::string& done) {
    if (status.ok()) print_line(global.json ? nlohmann::ordered_json({{"done", done}}).dump() : done);
    return status;
}

absl::Status run_start(const GlobalOptions& global, const ControlOptions& options) {
    ProgressLine line(global.json);
    line.draw("starting the capture ...");
    const absl::Status started = client::Client(global.client_options()).start(options.operator_name);
    line.clear();
    return report(global, started, "started");
}

absl::Status run_stop(const GlobalOptions& global, const ControlOptions& options) {
    return report(global, client::Client(global.client_options()).stop(options.operator_name), "stopped");
}

absl::Status run_learn(const GlobalOptions& global, const ControlOptions& options) {
    if (options.restore)
        return report(global,
                      client::Client(global.client_options()).restore_background(options.operator_name),
                      "restored");
    // Learning takes as long as its frames last; 10 per second is slow for a camera.
    const std::chrono::milliseconds timeout = global.client_options().timeout + std::chrono::seconds(20) +
                                              options.frames * std::chrono::milliseconds(100);
    ProgressLine line(global.json);
    line.draw("learning the background ...");
    const absl::Status learned =
        client::Client(global.client_options())
            .learn_background(options.operator_name, options.frames, timeout, options.force);
    line.clear();
    return report(global, learned, "learned");
}

}  // namespace

void add_control_verbs(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<ControlOptions>();
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const GlobalOptions&, const ControlOptions&)) {
        CLI::App* command = add_action(app, global, run, options, name, help, act);
        add_operator_option(*command, options->operator_name);
        return command;
    };
    add("start", "Start the capture (acquires control)", run_start);
    add("stop", "Stop the capture (acquires control)", run_stop);
    CLI::App* const learn = add("learn-background", "Relearn the background (acquires control)", run_learn);
    CLI::Option* const frames =
        learn
            ->add_option("--frames", options->frames,
                         "Live frame sets to learn from, scene empty (0: the source's background clip; "
                         "capture stopped)")
            ->check(CLI::Range(0, 1000))
            ->capture_default_str();
    CLI::Option* const force =
        learn->add_flag("--force", options->force, "Learn even while a subject is tracked");
    learn->add_flag("--restore", options->restore, "Restore the previous background (capture stopped)")
        ->excludes(frames)
        ->excludes(force);
}

}  // namespace kinevox::cli
