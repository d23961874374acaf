#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <ctime>

#include "client/cli/json.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct EventsOptions {
    int past = 20;
    int count = 0;  // 0: until stopped
    bool reconnect = false;
};

std::string event_text(const v1::WatchEventsResponse& event) {
    const std::time_t seconds = event.time_ns() / 1'000'000'000;
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    char time[32] = "";
    std::strftime(time, sizeof time, "%Y-%m-%dT%H:%M:%S", &utc);
    std::string out = fmt::format("{}.{:03}Z {:<18} ", time, event.time_ns() / 1'000'000 % 1000,
                                  short_name(*v1::EventKind_descriptor()->FindValueByNumber(event.kind())));
    if (event.sequence() > 0) out += fmt::format("frame {} ", event.sequence());
    if (!event.camera().empty()) out += event.camera() + " ";
    if (event.missed() > 0) out += fmt::format("({} events missed) ", event.missed());
    return out + event.message();
}

absl::Status run_events(const Common& common, const EventsOptions& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.reconnect = options.reconnect;
    stream.on_reconnect = [](const absl::Status& why) {
        fmt::print(stderr, "kinevox: {}; trying again\n", std::string(why.message()));
    };
    v1::WatchEventsRequest request;
    request.set_past(options.past);
    int shown = 0;
    const absl::Status status =
        client::Client(common.client_options())
            .watch_events(
                request,
                [&](const v1::WatchEventsResponse& event) {
                    const bool read = print_line(common.json ? to_json(event).dump() : event_text(event));
                    return read && ++shown != options.count;
                },
                stream);
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_events_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<EventsOptions>();
    CLI::App* events = app.add_subcommand("events", "Events as they happen, the last few first");
    add_common_options(*events, common);
    events->add_option("--past", options->past, "So many from before")
        ->check(CLI::Range(0, 100))
        ->capture_default_str();
    events->add_option("--count", options->count, "Events to show, 0: until stopped")
        ->check(CLI::NonNegativeNumber);
    events->add_flag("--reconnect", options->reconnect, "Wait for the daemon when it goes away");
    events->callback([&, options] { run = [&common, options] { return run_events(common, *options); }; });
}

}  // namespace kinevox::cli
