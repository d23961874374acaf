// `kinevox calibrate` with a daemon: the stored calibrations. The guided procedure is in calibrate_start.cc,
// the verbs on files in the program kinevox-calibrate.
#include "client/cli/calibrate_verb.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <ctime>
#include <filesystem>

#include "client/cli/action.h"
#include "client/cli/calibrate_text.h"
#include "client/cli/json.h"
#include "client/cli/report.h"
#include "common/atomic_file.h"

namespace kinevox::cli {
namespace {

struct Options {
    std::string name = default_operator_name();
    std::string id, file, format, note, out, page;
    bool restart = false, although_bad = false, follow = false;
};

// A call under control; its answer as JSON or text.
template <typename Request, typename Response>
absl::Status change(const Common& common, const std::string& name, Request request,
                    absl::StatusOr<Response> (client::Client::*call)(const Request&),
                    const std::function<std::string(const Response&)>& text) {
    client::Client client(common.client_options());
    return client.under_control(name, [&](const std::string& lease_id) {
        request.set_lease_id(lease_id);
        return report<Response>(common, (client.*call)(request), text);
    });
}

std::string date_text(std::int64_t time_ns) {
    const std::time_t seconds = time_ns / 1'000'000'000;
    std::tm utc{};
    gmtime_r(&seconds, &utc);
    char text[32] = "";
    std::strftime(text, sizeof text, "%Y-%m-%d %H:%MZ", &utc);
    return text;
}

std::string in_use_text(const std::string& id, bool in_use) {
    return (id.empty() ? "the source's own calibration" : id) +
           (in_use ? " is in use"
                   : " will be used from the capture's next start on; --restart does that now");
}

absl::Status run_list(const Common& common, const Options&) {
    const auto response = client::Client(common.client_options()).list_calibrations({});
    if (!response.ok()) return response.status();
    if (common.json) return print_line(to_json(*response).dump()), absl::OkStatus();
    for (const v1::CalibrationEntry& entry : response->calibrations()) {
        const bool next = entry.id() == response->at_next_start() && !entry.in_use();
        print_line(fmt::format("{:<5} {} {:<7} {:<7} {:<10} {}{}", entry.id(), date_text(entry.time_ns()),
                               verdict_text(entry.verdict()), entry.made_by(),
                               entry.in_use() ? "in use"
                               : next         ? "next start"
                                              : "",
                               entry.note(), entry.fits() ? "" : " (of other cameras)"));
    }
    if (response->in_use().empty()) print_line("in use: the source's own");
    return absl::OkStatus();
}

absl::Status run_certificate(const Common& common, const Options& options) {
    v1::GetCertificateRequest request;
    request.set_id(options.id);
    request.set_with_page(!options.page.empty());
    const auto response = client::Client(common.client_options()).get_certificate(request);
    if (!response.ok()) return response.status();
    if (!options.page.empty())
        if (absl::Status written = write_file_atomically(options.page, response->page_png()); !written.ok())
            return written;
    std::string text = common.json ? response->json() : certificate_text(response->certificate());
    while (text.ends_with('\n')) text.pop_back();
    print_line(text);
    return absl::OkStatus();
}

absl::Status run_apply(const Common& common, const Options& options) {
    v1::ApplyCalibrationRequest request;
    request.set_id(options.id);
    request.set_restart_capture(options.restart);
    request.set_although_bad(options.although_bad);
    return change<v1::ApplyCalibrationRequest, v1::ApplyCalibrationResponse>(
        common, options.name, request, &client::Client::apply_calibration,
        [&](const auto& response) { return in_use_text(options.id, response.in_use()); });
}

absl::Status run_undo(const Common& common, const Options& options) {
    v1::UndoCalibrationRequest request;
    request.set_restart_capture(options.restart);
    return change<v1::UndoCalibrationRequest, v1::UndoCalibrationResponse>(
        common, options.name, request, &client::Client::undo_calibration,
        [](const auto& response) { return in_use_text(response.id(), response.in_use()); });
}

absl::Status run_remove(const Common& common, const Options& options) {
    v1::RemoveCalibrationRequest request;
    request.set_id(options.id);
    return change<v1::RemoveCalibrationRequest, v1::RemoveCalibrationResponse>(
        common, options.name, request, &client::Client::remove_calibration,
        [&](const auto&) { return options.id + " is removed"; });
}

// By ending, and an OpenCV from a Kalibr file by its key, as `kinevox-calibrate import` does.
v1::CalibrationFormat format_of(const std::filesystem::path& file, const std::string& text) {
    const std::string ending = file.extension().string();
    if (ending == ".toml") return v1::CALIBRATION_FORMAT_TOML;
    if (ending == ".yml" || ending == ".yaml")
        return text.find("camera_model") != std::string::npos ? v1::CALIBRATION_FORMAT_KALIBR
                                                              : v1::CALIBRATION_FORMAT_OPENCV;
    return v1::CALIBRATION_FORMAT_QUALISYS;
}

absl::Status run_import(const Common& common, const Options& options) {
    auto text = read_file(options.file, 1 << 20);
    if (!text.ok()) return text.status();
    v1::ImportCalibrationRequest request;
    request.set_format(format_of(options.file, *text));
    request.set_note(options.note.empty() ? std::filesystem::path(options.file).filename().string()
                                          : options.note);
    request.set_text(*std::move(text));
    return change<v1::ImportCalibrationRequest, v1::ImportCalibrationResponse>(
        common, options.name, request, &client::Client::import_calibration, [](const auto& response) {
            return fmt::format("{}: {} cameras ({})", response.id(), response.cameras_size(),
                               fmt::join(response.cameras(), ", "));
        });
}

absl::Status run_export(const Common& common, const Options& options) {
    v1::ExportCalibrationRequest request;
    request.set_id(options.id);
    request.set_format(options.format == "kalibr"   ? v1::CALIBRATION_FORMAT_KALIBR
                       : options.format == "opencv" ? v1::CALIBRATION_FORMAT_OPENCV
                                                    : v1::CALIBRATION_FORMAT_TOML);
    const auto response = client::Client(common.client_options()).export_calibration(request);
    if (!response.ok()) return response.status();
    if (!options.out.empty()) return write_file_atomically(options.out, response->text());
    std::string text = response->text();
    while (text.ends_with('\n')) text.pop_back();
    print_line(text);
    return absl::OkStatus();
}

absl::Status run_watch(const Common& common, const Options& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    ProcedureText text;
    const absl::Status status = client::Client(common.client_options())
                                    .watch_procedure(
                                        [&](const v1::WatchProcedureResponse& progress) {
                                            const bool read = common.json
                                                                  ? print_line(to_json(progress).dump())
                                                                  : text.print(progress);
                                            return read && (options.follow || is_open(progress));
                                        },
                                        stream);
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

absl::Status run_cancel(const Common& common, const Options& options) {
    return change<v1::CancelProcedureRequest, v1::CancelProcedureResponse>(
        common, options.name, {}, &client::Client::cancel_procedure, [](const auto&) { return "cancelled"; });
}

bool is_id(const std::string& text) {
    return text.size() > 1 && text[0] == 'c' &&
           std::all_of(text.begin() + 1, text.end(), [](unsigned char c) { return std::isdigit(c); });
}

}  // namespace

bool wants_a_daemon(const std::vector<std::string>& arguments) {
    static const std::vector<std::string> kLive{"start",       "watch", "cancel", "list",
                                                "certificate", "apply", "undo",   "remove"};
    if (arguments.empty() || arguments[0].starts_with('-')) return true;  // tells about both
    const std::string& verb = arguments[0];
    const bool to_file = std::any_of(arguments.begin() + 1, arguments.end(), [](const std::string& argument) {
        return argument == "--out" || argument.starts_with("--out=");
    });
    if (verb == "import") return !to_file;
    if (verb == "export")  // a file, or what the daemon has stored or uses
        return arguments.size() < 2 || arguments[1].starts_with('-') || is_id(arguments[1]);
    return std::find(kLive.begin(), kLive.end(), verb) != kLive.end();
}

void add_calibrate_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<Options>();
    CLI::App* calibrate =
        app.add_subcommand("calibrate", "Cameras: lenses, places in the room, and whether to trust them");
    calibrate->require_subcommand(1);
    calibrate->footer(
        "On files, without a daemon: intrinsics, extrinsics, refine, check, import FILE --out OUT, export "
        "FILE --out OUT; "
        "`kinevox calibrate VERB --help` tells more.");
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const Common&, const Options&)) {
        return add_action(*calibrate, common, run, options, name, help, act);
    };
    const auto add_name = [&](CLI::App* verb) {
        verb->add_option("--name", options->name, "Under which name control is taken")->capture_default_str();
        return verb;
    };
    const auto add_id = [&](CLI::App* verb) {
        verb->add_option("id", options->id, "As `kinevox calibrate list` shows it: c7")->required();
        return verb;
    };
    const auto add_restart = [&](CLI::App* verb) {
        verb->add_flag("--restart", options->restart, "Stop a capture that runs and start it anew with it");
        return verb;
    };
    add_start_verb(*calibrate, common, run);
    add("watch", "The procedure as it goes on", run_watch)
        ->add_flag("--follow", options->follow, "Also after its end, for the next one");
    add_name(add("cancel", "End the procedure (takes control for the moment)", run_cancel));
    add("list", "The stored calibrations", run_list);
    add_id(
        add("certificate", "How good a calibration is, and why; --json: all that is known", run_certificate))
        ->add_option("--page", options->page, "Also as a page of pictures, into this PNG");
    CLI::App* apply = add_restart(
        add_name(add_id(add("apply", "Use a stored calibration (takes control for the moment)", run_apply))));
    apply->add_flag("--although-bad", options->although_bad,
                    "Even if its verdict is NO-GO or it has no floor");
    add_restart(
        add_name(add("undo", "Back to what was in use before (takes control for the moment)", run_undo)));
    add_name(add_id(add("remove", "Delete a stored calibration (takes control for the moment)", run_remove)));
    CLI::App* import =
        add_name(add("import",
                     "Store another program's calibration (takes control for the moment); with "
                     "--out: convert a file, without a daemon",
                     run_import));
    import
        ->add_option("file", options->file,
                     ".toml (Pose2Sim, aniposelib), .qca.txt (Qualisys), .yml (OpenCV, Kalibr)")
        ->required();
    import->add_option("--note", options->note, "Kept with it; else the file's name");
    CLI::App* export_ =
        add("export",
            "A stored calibration, or the one in use, as text; with a file: convert it, without a "
            "daemon",
            run_export);
    export_->add_option("id", options->id, "c7; none: the one in use");
    export_->add_option("--out", options->out, "Into this file; else on standard output");
    options->format = "toml";
    export_->add_option("--format", options->format, "toml, opencv or kalibr")
        ->check(CLI::IsMember({"toml", "opencv", "kalibr"}))
        ->capture_default_str();
}

}  // namespace kinevox::cli
