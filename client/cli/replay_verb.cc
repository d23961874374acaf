// `kinevox replay`: a recording instead of the cameras.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <filesystem>

#include "client/cli/output.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct ReplayOptions {
    std::string operator_name = default_operator_name();
    std::string source, position, on = "on";
    std::int64_t step_frames = 1;
    double speed = 1;
    bool paused = false, loop = false;
};

absl::Status report(const GlobalOptions& global, const v1::Replay& replay) {
    if (global.json) return print_line(to_json(replay).dump()), absl::OkStatus();
    std::string text = short_name(*v1::ReplayState_descriptor()->FindValueByNumber(replay.state()));
    if (!replay.session_path().empty())
        text += fmt::format(": {}, frame {} of {}, {:.3f} s, x{:g}{}", replay.session_path(),
                            replay.has_frame() ? fmt::to_string(replay.frame()) : "-", replay.frame_count(),
                            replay.position_s(), replay.speed(), replay.loop() ? ", loop" : "");
    print_line(text);
    return absl::OkStatus();
}

absl::Status run_replay_status(const GlobalOptions& global, const ReplayOptions&) {
    const auto response = client::Client(global.client_options()).get_replay();
    return response.ok() ? report(global, response->replay()) : response.status();
}

absl::Status run_open(const GlobalOptions& global, const ReplayOptions& options) {
    v1::OpenReplayRequest request;
    // The name of a recording, unless it looks like a path or is a file.
    std::error_code error;
    const std::filesystem::path given = options.source;
    if (given.has_parent_path() || std::filesystem::is_regular_file(given, error))
        request.set_session_path(std::filesystem::absolute(given).lexically_normal().string());
    else
        request.set_recording_name(options.source);
    request.set_paused(options.paused);
    request.set_loop(options.loop);
    request.set_speed(options.speed);
    const auto response = client::Client(global.client_options()).open_replay(options.operator_name, request);
    return response.ok() ? report(global, response->replay()) : response.status();
}

absl::Status run_close(const GlobalOptions& global, const ReplayOptions& options) {
    client::Client client(global.client_options());
    if (absl::Status closed = client.close_replay(options.operator_name); !closed.ok()) return closed;
    return run_replay_status(global, options);
}

absl::Status update(const GlobalOptions& global, const ReplayOptions& options,
                    const v1::UpdateReplayRequest& request) {
    const auto response =
        client::Client(global.client_options()).update_replay(options.operator_name, request);
    return response.ok() ? report(global, response->replay()) : response.status();
}

absl::Status run_play(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    request.set_playing(true);
    return update(global, options, request);
}

absl::Status run_pause(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    request.set_playing(false);
    return update(global, options, request);
}

absl::Status run_step(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    request.set_step_frames(options.step_frames);
    return update(global, options, request);
}

absl::Status run_speed(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    request.set_speed(options.speed);
    return update(global, options, request);
}

absl::Status run_loop(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    request.set_loop(options.on == "on");
    return update(global, options, request);
}

// "120" is a frame, "4.5s" a time.
absl::Status run_seek(const GlobalOptions& global, const ReplayOptions& options) {
    v1::UpdateReplayRequest request;
    const char* const begin = options.position.data();
    const char* const end = begin + options.position.size();
    std::int64_t frame = 0;
    double seconds = 0;
    const auto as_frame = std::from_chars(begin, end, frame);
    const auto as_time = std::from_chars(begin, end, seconds);
    if (as_frame.ec == std::errc() && as_frame.ptr == end)
        request.set_frame(frame);
    else if (as_time.ec == std::errc() && as_time.ptr + 1 == end && *as_time.ptr == 's')
        request.set_position_s(seconds);
    else
        return absl::InvalidArgumentError(fmt::format(
            "POSITION is '{}'; give a frame, such as 120, or a time, such as 4.5s", options.position));
    return update(global, options, request);
}

}  // namespace

void add_replay_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<ReplayOptions>();
    CLI::App* replay = app.add_subcommand("replay", "Replay a recording instead of the cameras");
    replay->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const GlobalOptions&, const ReplayOptions&)) {
        CLI::App* command = add_action(*replay, global, run, options, name, help, act);
        if (act != run_replay_status) add_operator_option(*command, options->operator_name);
        return command;
    };
    CLI::App* open = add("open", "Open a recording (acquires control)", run_open);
    open->add_option("NAME-or-PATH", options->source,
                     "Name shown by `kinevox record list`, or path of a session.toml on the server")
        ->required();
    open->add_flag("--paused", options->paused, "Start paused");
    open->add_flag("--loop", options->loop, "Loop");
    open->add_option("--speed", options->speed, "Playback speed (1: as recorded)")
        ->check(CLI::Range(0.01, 100.0));
    add("close", "Return to the cameras (acquires control)", run_close);
    add("status", "Show the replay's state", run_replay_status);
    add("play", "Play (acquires control)", run_play);
    add("pause", "Pause (acquires control)", run_pause);
    add("step", "Step forward by N frame sets (acquires control)", run_step)
        ->add_option("FRAMES", options->step_frames, "Number of frame sets (negative: back; default 1)");
    add("seek", "Go to a frame or time (acquires control)", run_seek)
        ->add_option("POSITION", options->position, "Frame, such as 120, or time, such as 4.5s")
        ->required();
    add("speed", "Set the playback speed (acquires control)", run_speed)
        ->add_option("FACTOR", options->speed, "0.01 to 100 (1: as recorded)")
        ->required();
    add("loop", "Switch looping on or off (acquires control)", run_loop)
        ->add_option("STATE", options->on, "on or off (default: on)")
        ->check(CLI::IsMember({"on", "off"}));
}

}  // namespace kinevox::cli
