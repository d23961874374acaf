// `kinevox calibrate` with a daemon: the stored calibrations. The guided procedure is in calibrate_start.cc,
// the commands on files are in the program kinevox-calibrate.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <google/protobuf/util/time_util.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <filesystem>
#include <string_view>
#include <utility>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "client/lib/guided_calibration.h"
#include "common/files.h"

namespace kinevox::cli {
namespace {

// Of kinevox-calibrate, for the help; the program describes their options.
constexpr std::array<std::pair<const char*, const char*>, 6> kFileCommands{
    {{"intrinsics", "Estimate intrinsics from images of a board"},
     {"extrinsics", "Estimate extrinsics from a moving board, wand or person"},
     {"floor", "Define the world frame from a board on the floor, clicked points or a walking person"},
     {"refine", "Refine extrinsics from a moving person's silhouettes"},
     {"check", "Check a session's calibration (GO, CAUTION, NO-GO)"},
     {"convert", "Convert a calibration file to another format"}}};

struct Options {
    std::string operator_name = default_operator_name();
    std::string id, file, format = "toml", note, out, image;
    bool restart = false, force = false, follow = false, yes = false, overwrite = false;
};

// A call under control; its response as JSON or text.
template <typename Request, typename Response>
absl::Status change(const GlobalOptions& global, const std::string& operator_name, Request request,
                    absl::StatusOr<Response> (client::Client::*call)(const Request&),
                    const std::function<std::string(const Response&)>& text) {
    client::Client client(global.client_options());
    return client.with_control(operator_name, [&](const client::Lease& lease) {
        request.set_lease_id(lease.id);
        return report<Response>(global, (client.*call)(request), text);
    });
}

std::string active_text(const std::string& id, bool active) {
    return (id.empty() ? "the source's own calibration" : id) +
           (active ? " is active"
                   : " is pending: active from the next start of the capture; --restart applies it now");
}

std::string calibrations_text(const v1::ListCalibrationsResponse& response) {
    Table table({"id", "created (UTC)", "verdict", "method", "state", "note"});
    if (response.active_id().empty()) table.add({"-", "", "", "", "active", "the source's own calibration"});
    for (const v1::Calibration& entry : response.calibrations()) {
        const char* const state = entry.active()                        ? "active"
                                  : entry.id() == response.pending_id() ? "pending"
                                  : entry.compatible()                  ? ""
                                                                        : "incompatible";
        table.add({entry.id(), google::protobuf::util::TimeUtil::ToString(entry.create_time()).substr(0, 16),
                   client::verdict_text(entry.verdict(), "-"), client::method_text(entry.method()), state,
                   entry.note()});
    }
    return table.text();
}

absl::Status run_list(const GlobalOptions& global, const Options&) {
    return report<v1::ListCalibrationsResponse>(
        global, client::Client(global.client_options()).list_calibrations({}), calibrations_text);
}

absl::Status run_show(const GlobalOptions& global, const Options& options) {
    if (!options.image.empty())
        if (absl::Status free = check_overwrite(options.overwrite, options.image); !free.ok()) return free;
    v1::GetCertificateRequest request;
    request.set_calibration_id(options.id);
    request.set_include_page(!options.image.empty());
    const auto response = client::Client(global.client_options()).get_certificate(request);
    if (!response.ok()) return response.status();
    if (!options.image.empty())
        if (absl::Status written = write_file_atomically(options.image, response->page_png()); !written.ok())
            return written;
    std::string text = global.json ? response->certificate_json() : certificate_text(response->certificate());
    while (text.ends_with('\n')) text.pop_back();
    print_line(text);
    return absl::OkStatus();
}

absl::Status run_apply(const GlobalOptions& global, const Options& options) {
    v1::ApplyCalibrationRequest request;
    request.set_calibration_id(options.id);
    request.set_restart_capture(options.restart);
    request.set_force(options.force);
    return change<v1::ApplyCalibrationRequest, v1::ApplyCalibrationResponse>(
        global, options.operator_name, request, &client::Client::apply_calibration,
        [&](const auto& response) { return active_text(options.id, response.active()); });
}

absl::Status run_undo(const GlobalOptions& global, const Options& options) {
    v1::UndoCalibrationRequest request;
    request.set_restart_capture(options.restart);
    return change<v1::UndoCalibrationRequest, v1::UndoCalibrationResponse>(
        global, options.operator_name, request, &client::Client::undo_calibration,
        [](const auto& response) { return active_text(response.calibration_id(), response.active()); });
}

absl::Status run_delete(const GlobalOptions& global, const Options& options) {
    if (absl::Status confirmed = confirm_deletion(options.yes, "calibration " + options.id); !confirmed.ok())
        return confirmed;
    v1::DeleteCalibrationRequest request;
    request.set_calibration_id(options.id);
    return change<v1::DeleteCalibrationRequest, v1::DeleteCalibrationResponse>(
        global, options.operator_name, request, &client::Client::delete_calibration,
        [&](const auto&) { return "deleted " + options.id; });
}

// By the extension; OpenCV and Kalibr by a key, as `kinevox calibrate convert` does.
v1::CalibrationFormat format_of(const std::filesystem::path& file, const std::string& text) {
    const std::string extension = file.extension().string();
    if (extension == ".toml") return v1::CALIBRATION_FORMAT_TOML;
    if (extension == ".yml" || extension == ".yaml")
        return text.find("camera_model") != std::string::npos ? v1::CALIBRATION_FORMAT_KALIBR
                                                              : v1::CALIBRATION_FORMAT_OPENCV;
    return v1::CALIBRATION_FORMAT_QUALISYS;
}

absl::Status run_import(const GlobalOptions& global, const Options& options) {
    auto text = read_file(options.file, 1 << 20);
    if (!text.ok()) return text.status();
    v1::ImportCalibrationRequest request;
    request.set_format(format_of(options.file, *text));
    request.set_note(options.note.empty() ? std::filesystem::path(options.file).filename().string()
                                          : options.note);
    request.set_data(*std::move(text));
    return change<v1::ImportCalibrationRequest, v1::ImportCalibrationResponse>(
        global, options.operator_name, request, &client::Client::import_calibration,
        [](const auto& response) {
            return fmt::format("{}: {} ({})", response.calibration_id(),
                               count_of(static_cast<std::uint64_t>(response.cameras_size()), "camera"),
                               fmt::join(response.cameras(), ", "));
        });
}

absl::Status run_export(const GlobalOptions& global, const Options& options) {
    if (!options.out.empty())
        if (absl::Status free = check_overwrite(options.overwrite, options.out); !free.ok()) return free;
    v1::ExportCalibrationRequest request;
    request.set_calibration_id(options.id);
    request.set_format(options.format == "kalibr"   ? v1::CALIBRATION_FORMAT_KALIBR
                       : options.format == "opencv" ? v1::CALIBRATION_FORMAT_OPENCV
                                                    : v1::CALIBRATION_FORMAT_TOML);
    const auto response = client::Client(global.client_options()).export_calibration(request);
    if (!response.ok()) return response.status();
    if (!options.out.empty())
        if (absl::Status written = write_file_atomically(options.out, response->data()); !written.ok())
            return written;
    if (global.json) {
        nlohmann::ordered_json out{{"format", options.format}};
        options.out.empty() ? out["data"] = response->data() : out["out"] = options.out;
        print_line(out.dump());
    } else if (options.out.empty()) {
        std::string text = response->data();
        while (text.ends_with('\n')) text.pop_back();
        print_line(text);
    }
    return absl::OkStatus();
}

absl::Status run_watch(const GlobalOptions& global, const Options& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    ProcedureText text;
    const absl::Status status = client::Client(global.client_options())
                                    .watch_procedure(
                                        [&](const v1::WatchProcedureResponse& progress) {
                                            const bool read = global.json
                                                                  ? print_line(to_json(progress).dump())
                                                                  : text.print(progress);
                                            return read && (options.follow || client::is_open(progress));
                                        },
                                        stream);
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

absl::Status run_cancel(const GlobalOptions& global, const Options& options) {
    return change<v1::CancelProcedureRequest, v1::CancelProcedureResponse>(
        global, options.operator_name, {}, &client::Client::cancel_procedure,
        [](const auto&) { return "cancelled"; });
}

}  // namespace

bool is_calibrate_file_command(const std::string& name) {
    return std::ranges::any_of(kFileCommands, [&](const auto& command) { return name == command.first; });
}

void add_calibrate_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<Options>();
    CLI::App* calibrate =
        app.add_subcommand("calibrate", "Camera calibration: intrinsics, extrinsics and their quality");
    calibrate->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const GlobalOptions&, const Options&)) {
        return add_action(*calibrate, global, run, options, name, help, act);
    };
    const auto add_changing = [&](const char* name, const char* help,
                                  absl::Status (*act)(const GlobalOptions&, const Options&)) {
        CLI::App* command = add(name, help, act);
        add_operator_option(*command, options->operator_name);
        return command;
    };
    const auto add_id = [&](CLI::App* command) {
        command->add_option("ID", options->id, "Id shown by `kinevox calibrate list`, such as c7")
            ->required();
        return command;
    };
    const auto add_restart = [&](CLI::App* command) {
        command->add_flag("--restart", options->restart, "Restart the capture so that it takes effect now");
        return command;
    };
    add_start_verb(*calibrate, global, run);
    add("watch", "Show the procedure's progress", run_watch)
        ->add_flag("--follow", options->follow, "Keep watching for the next one");
    add_changing("cancel", "Cancel the procedure (acquires control)", run_cancel);
    add("list", "List stored calibrations", run_list);
    CLI::App* show = add_id(add("show", "Show a calibration's certificate", run_show));
    show->add_option("--image", options->image, "Also save it as an image (PNG)");
    add_overwrite_option(*show, options->overwrite);
    add_restart(add_id(add_changing("apply", "Apply a stored calibration (acquires control)", run_apply)))
        ->add_flag("--force", options->force, "Apply even if NO-GO or without a world frame");
    add_restart(add_changing("undo", "Revert to the previous calibration (acquires control)", run_undo));
    add_yes_option(
        *add_id(add_changing("delete", "Delete a stored calibration (acquires control)", run_delete)),
        options->yes);
    CLI::App* import = add_changing("import", "Import a calibration file (acquires control)", run_import);
    import
        ->add_option("FILE", options->file,
                     ".toml (Pose2Sim, aniposelib), .qca.txt (Qualisys), .yml (OpenCV, Kalibr)")
        ->required();
    import->add_option("--note", options->note, "Note (default: the file name)");
    CLI::App* export_ = add("export", "Export a calibration (default: the active one)", run_export);
    export_->add_option("ID", options->id, "Id shown by `kinevox calibrate list`, such as c7");
    export_->add_option("--out", options->out, "Output file (default: standard output)");
    add_overwrite_option(*export_, options->overwrite);
    export_->add_option("--format", options->format, "toml, opencv or kalibr")
        ->check(CLI::IsMember({"toml", "opencv", "kalibr"}))
        ->capture_default_str();
    for (CLI::App* command : calibrate->get_subcommands([](CLI::App*) { return true; }))
        command->group("Daemon");
    for (const auto& [name, help] : kFileCommands) calibrate->add_subcommand(name, help)->group("Files");
}

}  // namespace kinevox::cli
