// `kinevox watch`.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <condition_variable>
#include <mutex>

#include "client/cli/output.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct WatchOptions {
    double interval_s = 1;
    int count = 0;  // 0: until stopped
};

// False when stopped.
bool pause(std::stop_token stop, double seconds) {
    std::mutex mutex;
    std::condition_variable_any changed;
    std::unique_lock lock(mutex);
    changed.wait_for(lock, stop, std::chrono::duration<double>(seconds), [] { return false; });
    return !stop.stop_requested();
}

absl::Status run_watch(const GlobalOptions& global, const WatchOptions& options) {
    const std::stop_token stop = stop_on_signals();
    const bool redraw = !global.json && isatty(STDOUT_FILENO);
    client::Client client(global.client_options());
    bool seen = false;
    for (int shown = 0; !stop.stop_requested();) {
        const auto status = client.status();
        if (!status.ok() && !(seen && absl::IsUnavailable(status.status()))) return status.status();
        std::string text;
        if (!status.ok())  // it may restart; standard output gets statuses only
            redraw ? void(text = std::string(status.status().message()))
                   : void(fmt::print(stderr, "kinevox: {}\n", std::string(status.status().message())));
        else
            text = global.json ? to_json(*status).dump()
                   : redraw    ? status_text(*status)
                               : status_line(*status);
        if (redraw) text = "\x1b[H\x1b[J" + text;  // home, clear
        if (!text.empty() && !print_line(text)) return absl::OkStatus();
        seen = seen || status.ok();
        if (status.ok() && ++shown == options.count) return absl::OkStatus();
        if (!pause(stop, options.interval_s)) break;
    }
    return absl::OkStatus();
}

}  // namespace

void add_watch_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<WatchOptions>();
    CLI::App* watch =
        add_action(app, global, run, options, "watch", "Show live rates, stage times and losses", run_watch);
    watch->add_option("--interval", options->interval_s, "Refresh interval (s)")
        ->check(CLI::Range(0.05, 3600.0))
        ->capture_default_str();
    watch->add_option("--count", options->count, "Number of updates (0: until stopped)")
        ->check(CLI::NonNegativeNumber);
}

}  // namespace kinevox::cli
