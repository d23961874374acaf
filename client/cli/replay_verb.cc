// `kinevox replay`: a recording in the place of the cameras.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <filesystem>

#include "client/cli/action.h"
#include "client/cli/json.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct ReplayOptions {
    std::string name = default_operator_name();
    std::string session, where, on = "on";
    std::int64_t step = 1;
    double speed = 1;
    bool paused = false, loop = false;
};

absl::Status report(const Common& common, const v1::Replay& replay) {
    if (common.json) return print_line(to_json(replay).dump()), absl::OkStatus();
    std::string text = short_name(*v1::ReplayState_descriptor()->FindValueByNumber(replay.state()));
    if (!replay.session().empty())
        text += fmt::format(": {}, frame {} of {}, {:.3f} s, {:g} times its speed{}", replay.session(),
                            replay.frame(), replay.frames(), replay.position_s(), replay.speed(),
                            replay.loop() ? ", again and again" : "");
    print_line(text);
    return absl::OkStatus();
}

absl::Status run_shown(const Common& common, const ReplayOptions&) {
    const auto answer = client::Client(common.client_options()).get_replay();
    return answer.ok() ? report(common, answer->replay()) : answer.status();
}

absl::Status run_open(const Common& common, const ReplayOptions& options) {
    v1::OpenReplayRequest request;
    // The name of a recording, unless it looks like a file or is one.
    std::error_code error;
    const std::filesystem::path given = options.session;
    const bool is_file = given.has_parent_path() || std::filesystem::is_regular_file(given, error);
    request.set_session(is_file ? std::filesystem::absolute(given).lexically_normal().string()
                                : options.session);
    request.set_paused(options.paused);
    request.set_loop(options.loop);
    request.set_speed(options.speed);
    const auto answer = client::Client(common.client_options()).open_replay(options.name, request);
    return answer.ok() ? report(common, answer->replay()) : answer.status();
}

absl::Status run_live(const Common& common, const ReplayOptions& options) {
    client::Client client(common.client_options());
    if (absl::Status closed = client.close_replay(options.name); !closed.ok()) return closed;
    return run_shown(common, options);
}

absl::Status set(const Common& common, const ReplayOptions& options, const v1::SetReplayRequest& request) {
    const auto answer = client::Client(common.client_options()).set_replay(options.name, request);
    return answer.ok() ? report(common, answer->replay()) : answer.status();
}

absl::Status run_play(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    request.set_play(true);
    return set(common, options, request);
}

absl::Status run_pause(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    request.set_play(false);
    return set(common, options, request);
}

absl::Status run_step(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    request.set_step(options.step);
    return set(common, options, request);
}

absl::Status run_speed(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    request.set_speed(options.speed);
    return set(common, options, request);
}

absl::Status run_loop(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    request.set_loop(options.on == "on");
    return set(common, options, request);
}

// "120" is a frame, "4.5s" a time.
absl::Status run_seek(const Common& common, const ReplayOptions& options) {
    v1::SetReplayRequest request;
    const char* const begin = options.where.data();
    const char* const end = begin + options.where.size();
    std::int64_t frame = 0;
    double seconds = 0;
    const auto whole = std::from_chars(begin, end, frame);
    const auto time = std::from_chars(begin, end, seconds);
    if (whole.ec == std::errc() && whole.ptr == end)
        request.set_frame(frame);
    else if (time.ec == std::errc() && time.ptr + 1 == end && *time.ptr == 's')
        request.set_position_s(seconds);
    else
        return absl::InvalidArgumentError(
            fmt::format("'{}' is neither a frame, such as 120, nor a time, such as 4.5s", options.where));
    return set(common, options, request);
}

}  // namespace

void add_replay_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<ReplayOptions>();
    CLI::App* replay =
        app.add_subcommand("replay", "A recording in the place of the cameras: every other verb works on it");
    replay->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const Common&, const ReplayOptions&)) {
        CLI::App* action = add_action(*replay, common, run, options, name, help, act);
        if (act != run_shown)
            action->add_option("--name", options->name, "Under which name control is taken")
                ->capture_default_str();
        return action;
    };
    CLI::App* open =
        add("open", "Show a recording instead of the cameras (takes control for the moment)", run_open);
    open->add_option("session", options->session,
                     "Its name, as `kinevox record list` shows it, or a session.toml on the daemon's machine")
        ->required();
    open->add_flag("--paused", options->paused, "Show the first frame set and wait");
    open->add_flag("--loop", options->loop, "Again and again");
    open->add_option("--speed", options->speed, "Times the recording's own")->check(CLI::Range(0.01, 100.0));
    add("live", "Back to the cameras", run_live);
    add("status", "What is shown, and where it is", run_shown);
    add("play", "Go on", run_play);
    add("pause", "Stand still", run_pause);
    CLI::App* step = add("step", "One frame set on, or so many; negative: back", run_step);
    step->add_option("frames", options->step, "How many");
    add("seek", "Go to a frame, 120, or a time, 4.5s", run_seek)
        ->add_option("where", options->where)
        ->required();
    add("speed", "Times the recording's own, 0.01 to 100", run_speed)
        ->add_option("speed", options->speed)
        ->required();
    add("loop", "Again and again: on or off", run_loop)
        ->add_option("on", options->on)
        ->check(CLI::IsMember({"on", "off"}));
}

}  // namespace kinevox::cli
