// `kinevox record`: recordings on the server.
#include <fmt/format.h>
#include <google/protobuf/util/time_util.h>

#include <CLI/CLI.hpp>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "common/progress_line.h"
#include "common/proto_time.h"

namespace kinevox::cli {
namespace {

using google::protobuf::util::TimeUtil;

struct RecordOptions {
    std::string operator_name = default_operator_name();
    std::string name, codec;
    double duration_s = 0;
    bool continue_recording = false, yes = false;
};

constexpr std::chrono::seconds kWriteTimeout{120};  // of what is queued or buffered

std::string codec_name(const v1::Recording& recording) {
    return short_name(*v1::RecordingCodec_descriptor()->FindValueByNumber(recording.codec()));
}

// Losses, and how the recording ended.
std::string notes(const v1::Recording& recording) {
    std::string text;
    const auto add = [&](const std::string& note) { text += (text.empty() ? "" : ", ") + note; };
    if (recording.dropped_frame_set_count() > 0)
        add(count_of(recording.dropped_frame_set_count(), "frame set") + " dropped");
    if (recording.lost_frame_set_count() > 0)
        add(count_of(recording.lost_frame_set_count(), "frame set") + " lost before the recorder");
    if (recording.missing_image_count() > 0)
        add(count_of(recording.missing_image_count(), "image") + " missing");
    if (recording.recovered()) add("recovered");
    if (!recording.closed()) add("open");
    if (!recording.end_reason().empty()) add(recording.end_reason());
    return text;
}

std::string recording_text(const v1::Recording& recording) {
    const std::string rest = notes(recording);
    return fmt::format("{}: {}, {:.1f} s, {} MB, {}{}", recording.name(),
                       count_of(recording.frame_set_count(), "frame set"), to_seconds(recording.duration()),
                       recording.size_bytes() >> 20, codec_name(recording), rest.empty() ? "" : "; " + rest);
}

std::string recordings_text(const v1::ListRecordingsResponse& response) {
    if (response.recordings().empty()) return "no recordings";
    Table table({"name", "start (UTC)", ">frame sets", ">s", ">MB", "codec", "notes"});
    for (const v1::Recording& recording : response.recordings())
        table.add({recording.name(), TimeUtil::ToString(recording.start_time()).substr(0, 19),
                   fmt::to_string(recording.frame_set_count()),
                   fmt::format("{:.1f}", to_seconds(recording.duration())),
                   fmt::to_string(recording.size_bytes() >> 20), codec_name(recording), notes(recording)});
    return table.text();
}

std::string recorder_text(const v1::GetRecorderStatusResponse& status) {
    std::string text = short_name(*v1::RecorderState_descriptor()->FindValueByNumber(status.state()));
    if (status.state() == v1::RECORDER_STATE_DISABLED)
        return text + ": no recording folder is configured ([recording] folder)";
    if (status.has_current()) text += "\n  current  " + recording_text(status.current());
    if (status.has_latest()) text += "\n  latest   " + recording_text(status.latest());
    text += fmt::format("\n  folder   {}, {} MB free", status.folder(), status.free_bytes() >> 20);
    text +=
        fmt::format("\n  queue    {} of {} MB", status.queued_bytes() >> 20, status.max_queued_bytes() >> 20);
    if (const double length = to_seconds(status.max_buffer_duration()); length > 0)
        text += fmt::format("\n  buffer   {:.1f} of {:g} s, {} of {} MB{}",
                            to_seconds(status.buffered_duration()), length, status.buffered_bytes() >> 20,
                            status.max_buffer_bytes() >> 20,
                            status.buffer_limited_by_memory() ? ", limited by memory" : "");
    return text;
}

v1::RecordingCodec codec_of(const std::string& name) {
    if (name == "ffv1") return v1::RECORDING_CODEC_FFV1;
    if (name == "utvideo") return v1::RECORDING_CODEC_UTVIDEO;
    return name == "h264" ? v1::RECORDING_CODEC_H264 : v1::RECORDING_CODEC_UNSPECIFIED;
}

absl::Status run_start(const GlobalOptions& global, const RecordOptions& options) {
    v1::StartRecordingRequest request;
    request.set_name(options.name);
    request.set_codec(codec_of(options.codec));
    const auto response =
        client::Client(global.client_options()).start_recording(options.operator_name, request);
    return report<v1::StartRecordingResponse>(
        global, response, [](const auto& started) { return fmt::format("recording {}", started.name()); });
}

absl::Status run_stop(const GlobalOptions& global, const RecordOptions& options) {
    ProgressLine line(global.json);
    line.draw("writing the queue ...");
    const auto response =
        client::Client(global.client_options()).stop_recording(options.operator_name, kWriteTimeout);
    line.clear();
    return report<v1::StopRecordingResponse>(
        global, response, [](const auto& stopped) { return recording_text(stopped.recording()); });
}

absl::Status run_save(const GlobalOptions& global, const RecordOptions& options) {
    v1::SaveBufferRequest request;
    request.set_name(options.name);
    *request.mutable_duration() = duration_from_s(options.duration_s);
    request.set_continue_recording(options.continue_recording);
    ProgressLine line(global.json);
    line.draw("writing the buffer ...");
    const auto response =
        client::Client(global.client_options()).save_buffer(options.operator_name, request, kWriteTimeout);
    line.clear();
    return report<v1::SaveBufferResponse>(
        global, response, [](const auto& saved) { return recording_text(saved.recording()); });
}

absl::Status run_status(const GlobalOptions& global, const RecordOptions&) {
    const auto response = client::Client(global.client_options()).recorder_status();
    return report<v1::GetRecorderStatusResponse>(global, response, recorder_text);
}

absl::Status run_list(const GlobalOptions& global, const RecordOptions&) {
    const auto response = client::Client(global.client_options()).list_recordings();
    return report<v1::ListRecordingsResponse>(global, response, recordings_text);
}

absl::Status run_delete(const GlobalOptions& global, const RecordOptions& options) {
    if (absl::Status confirmed = confirm_deletion(options.yes, "recording " + options.name); !confirmed.ok())
        return confirmed;
    v1::DeleteRecordingRequest request;
    request.set_name(options.name);
    const auto response =
        client::Client(global.client_options()).delete_recording(options.operator_name, request);
    return report<v1::DeleteRecordingResponse>(
        global, response, [&](const auto&) { return fmt::format("deleted {}", options.name); });
}

}  // namespace

void add_record_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<RecordOptions>();
    CLI::App* record = app.add_subcommand("record", "Manage recordings on the server");
    record->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const GlobalOptions&, const RecordOptions&)) {
        return add_action(*record, global, run, options, name, help, act);
    };
    const auto add_changing = [&](const char* name, const char* help,
                                  absl::Status (*act)(const GlobalOptions&, const RecordOptions&)) {
        CLI::App* command = add(name, help, act);
        add_operator_option(*command, options->operator_name);
        return command;
    };
    const auto add_new_name = [&](CLI::App* command) {
        command->add_option("NAME", options->name,
                            "Recording name: letters, digits, . _ - (default: date and time)");
    };
    CLI::App* start = add_changing("start", "Start recording (acquires control)", run_start);
    add_new_name(start);
    start
        ->add_option("--codec", options->codec,
                     "ffv1 or utvideo (lossless), or h264 (default: as configured)")
        ->check(CLI::IsMember({"ffv1", "utvideo", "h264"}));
    add_changing("stop", "Stop recording (acquires control)", run_stop);
    CLI::App* save =
        add_changing("save", "Save the rolling buffer as a recording (acquires control)", run_save);
    add_new_name(save);
    save->add_option("--duration", options->duration_s, "Length to save (s; 0: the whole buffer)")
        ->check(CLI::Range(0.0, 86400.0));
    save->add_flag("--continue", options->continue_recording, "Continue recording without a gap");
    add("status", "Show the recorder's state", run_status);
    add("list", "List recordings", run_list);
    add_record_export_verb(*record, global, run);
    CLI::App* remove = add_changing("delete", "Delete a recording (acquires control)", run_delete);
    remove->add_option("NAME", options->name, "Name shown by `kinevox record list`")->required();
    add_yes_option(*remove, options->yes);
}

}  // namespace kinevox::cli
