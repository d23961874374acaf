// `kinevox record`: recordings on the daemon's machine.
#include <fmt/chrono.h>
#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "client/cli/action.h"
#include "client/cli/report.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct RecordOptions {
    std::string operator_name = default_operator_name();
    std::string name, codec;
    double seconds = 0;
    bool go_on = false;
};

constexpr std::chrono::seconds kMaxWriting{120};  // of what is queued or kept

std::string recording_text(const v1::Recording& recording) {
    std::string text =
        fmt::format("{:<24} {:>6} frames {:8.1f} s {:>7} MB  {}", recording.name(), recording.frames(),
                    recording.seconds(), recording.bytes() >> 20,
                    short_name(*v1::RecordingCodec_descriptor()->FindValueByNumber(recording.codec())));
    if (recording.dropped() > 0) text += fmt::format(", {} dropped", recording.dropped());
    if (recording.lost() > 0) text += fmt::format(", {} lost before", recording.lost());
    if (recording.missing_pictures() > 0)
        text += fmt::format(", {} pictures missing", recording.missing_pictures());
    if (recording.recovered()) text += ", recovered";
    if (!recording.closed()) text += ", open";
    if (!recording.end_reason().empty()) text += "; " + recording.end_reason();
    return text;
}

std::string recorder_text(const v1::GetRecorderStatusResponse& status) {
    std::string text = short_name(*v1::RecorderState_descriptor()->FindValueByNumber(status.state()));
    if (status.state() == v1::RECORDER_STATE_OFF) return text + ": the daemon has no folder for recordings";
    if (status.has_recording()) text += "\n  now    " + recording_text(status.recording());
    if (status.has_last()) text += "\n  last   " + recording_text(status.last());
    text += fmt::format("\n  folder {}, {} MB free", status.folder(), status.free_bytes() >> 20);
    text += fmt::format("\n  queue  {} of {} MB", status.queued_bytes() >> 20, status.queue_bytes() >> 20);
    if (status.keep_last_seconds() > 0)
        text +=
            fmt::format("\n  kept   the last {:.1f} of {:g} s, {} of {} MB{}", status.held_seconds(),
                        status.keep_last_seconds(), status.held_bytes() >> 20, status.keep_last_bytes() >> 20,
                        status.held_shortened() ? ", shortened by that bound" : "");
    return text;
}

v1::RecordingCodec codec_of(const std::string& name) {
    if (name == "ffv1") return v1::RECORDING_CODEC_FFV1;
    if (name == "utvideo") return v1::RECORDING_CODEC_UTVIDEO;
    return name == "h264" ? v1::RECORDING_CODEC_H264 : v1::RECORDING_CODEC_UNSPECIFIED;
}

absl::Status run_start(const Common& common, const RecordOptions& options) {
    v1::StartRecordingRequest request;
    request.set_name(options.name);
    request.set_codec(codec_of(options.codec));
    const auto response =
        client::Client(common.client_options()).start_recording(options.operator_name, request);
    return report<v1::StartRecordingResponse>(
        common, response, [](const auto& started) { return fmt::format("recording {}", started.name()); });
}

absl::Status run_stop(const Common& common, const RecordOptions& options) {
    const auto response =
        client::Client(common.client_options()).stop_recording(options.operator_name, kMaxWriting);
    return report<v1::StopRecordingResponse>(
        common, response, [](const auto& stopped) { return recording_text(stopped.recording()); });
}

absl::Status run_keep(const Common& common, const RecordOptions& options) {
    v1::KeepLastRequest request;
    request.set_name(options.name);
    request.set_seconds(options.seconds);
    request.set_go_on(options.go_on);
    const auto response =
        client::Client(common.client_options()).keep_last(options.operator_name, request, kMaxWriting);
    return report<v1::KeepLastResponse>(common, response,
                                        [](const auto& kept) { return recording_text(kept.recording()); });
}

absl::Status run_status(const Common& common, const RecordOptions&) {
    const auto response = client::Client(common.client_options()).recorder_status();
    return report<v1::GetRecorderStatusResponse>(common, response, recorder_text);
}

absl::Status run_list(const Common& common, const RecordOptions&) {
    const auto response = client::Client(common.client_options()).list_recordings();
    if (common.json || !response.ok()) return report<v1::ListRecordingsResponse>(common, response, {});
    for (const v1::Recording& recording : response->recordings()) print_line(recording_text(recording));
    return absl::OkStatus();
}

absl::Status run_delete(const Common& common, const RecordOptions& options) {
    v1::DeleteRecordingRequest request;
    request.set_name(options.name);
    const auto response =
        client::Client(common.client_options()).delete_recording(options.operator_name, request);
    return report<v1::DeleteRecordingResponse>(
        common, response, [&](const auto&) { return fmt::format("deleted {}", options.name); });
}

}  // namespace

void add_record_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<RecordOptions>();
    CLI::App* record = app.add_subcommand("record", "Recordings on the daemon's machine");
    record->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const Common&, const RecordOptions&)) {
        return add_action(*record, common, run, options, name, help, act);
    };
    const auto add_operator = [&](CLI::App* verb) {
        verb->add_option("--operator", options->operator_name, "Under which name control is taken")
            ->capture_default_str();
        return verb;
    };
    const auto add_name = [&](CLI::App* verb) {
        verb->add_option("--name", options->name,
                         "Of the recording: letters, digits, . _ -; date and time if not given");
        return verb;
    };
    CLI::App* start = add_name(add_operator(
        add("start", "Record from the next frame set on (takes control for the moment)", run_start)));
    start
        ->add_option("--codec", options->codec, "ffv1 or utvideo, both lossless, or h264; else as configured")
        ->check(CLI::IsMember({"ffv1", "utvideo", "h264"}));
    add_operator(add("stop", "Stop recording (takes control for the moment)", run_stop));
    CLI::App* keep = add_name(add_operator(
        add("keep", "Write out what the daemon has kept of the last seconds (takes control for the moment)",
            run_keep)));
    keep->add_option("--seconds", options->seconds, "Of the newest; 0: all that is kept")
        ->check(CLI::Range(0.0, 86400.0));
    keep->add_flag("--go-on", options->go_on, "Record on from there");
    add("status", "What is being recorded and kept", run_status);
    add("list", "The recordings", run_list);
    add_operator(add("delete", "Remove a recording (takes control for the moment)", run_delete))
        ->add_option("recording", options->name, "As `kinevox record list` shows it")
        ->required();
}

}  // namespace kinevox::cli
