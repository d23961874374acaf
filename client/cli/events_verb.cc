// `kinevox events`.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <ctime>

#include "client/cli/output.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct EventsOptions {
    int history = 20;
    int count = 0;  // 0: until stopped
    bool reconnect = false;
};

std::string event_text(const v1::WatchEventsResponse& response) {
    const v1::Event& event = response.event();
    const std::time_t seconds = event.event_time().seconds();
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    char time[32] = "";
    std::strftime(time, sizeof time, "%Y-%m-%dT%H:%M:%S", &utc);
    std::string out = fmt::format("{}.{:03}Z {:<24} ", time, event.event_time().nanos() / 1'000'000,
                                  short_name(*v1::EventKind_descriptor()->FindValueByNumber(event.kind())));
    if (event.sequence() > 0) out += fmt::format("frame {} ", event.sequence());
    if (!event.camera().empty()) out += event.camera() + " ";
    if (event.subject_id() > 0) out += fmt::format("subject {} ", event.subject_id());
    if (response.missed_count() > 0) out += fmt::format("({} events missed) ", response.missed_count());
    return out + event.message();
}

// The event's fields, and how many were missed before it.
std::string event_json(const v1::WatchEventsResponse& response) {
    nlohmann::ordered_json out = to_json(response.event());
    out["missed_count"] = response.missed_count();
    return out.dump();
}

absl::Status run_events(const GlobalOptions& global, const EventsOptions& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.reconnect = options.reconnect;
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox: {}; reconnecting\n", std::string(why.message()));
    };
    v1::WatchEventsRequest request;
    request.set_history_count(options.history);
    int shown = 0;
    const absl::Status status =
        client::Client(global.client_options())
            .watch_events(
                request,
                [&](const v1::WatchEventsResponse& event) {
                    const bool read = print_line(global.json ? event_json(event) : event_text(event));
                    return read && ++shown != options.count;
                },
                stream);
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_events_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<EventsOptions>();
    CLI::App* events =
        add_action(app, global, run, options, "events", "Show events as they happen", run_events);
    events->add_option("--history", options->history, "Number of past events shown first")
        ->check(CLI::Range(0, 100))
        ->capture_default_str();
    events->add_option("--count", options->count, "Number of events to show (0: until stopped)")
        ->check(CLI::NonNegativeNumber);
    events->add_flag("--reconnect", options->reconnect, "Reconnect when the daemon becomes unavailable");
}

}  // namespace kinevox::cli
