#include "client/cli/export_verb.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "client/cli/action.h"
#include "client/cli/json.h"
#include "client/cli/verbs.h"
#include "common/progress_line.h"

namespace kinevox::cli {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
    std::string session, format, frames, camera;
    fs::path out;
    double turn_deg = 0, wait_s = 600;
    int width_px = 0;
    bool hold = false, anonymous = false;
};

absl::StatusOr<v1::ExportFormat> format_of(std::string name) {
    std::ranges::transform(name, name.begin(),
                           [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    v1::ExportFormat format = v1::EXPORT_FORMAT_UNSPECIFIED;
    if (!v1::ExportFormat_Parse("EXPORT_FORMAT_" + name, &format))
        return absl::InvalidArgumentError(fmt::format("there is no format '{}'", name));
    return format;
}

// What the pieces make, written beside and renamed when it is whole.
class PieceFiles {
  public:
    PieceFiles(fs::path out, bool many) : out_(std::move(out)), many_(many) {}

    absl::Status add(const v1::ExportResponse& piece) {
        if (!file_.is_open()) {
            const fs::path name = fs::path(piece.file_name()).filename();  // nothing leads out of the folder
            target_ = many_ ? out_ / name : out_;
            std::error_code error;
            if (target_.has_parent_path()) fs::create_directories(target_.parent_path(), error);
            aside_ = target_.string() + ".part";
            file_.open(aside_, std::ios::binary | std::ios::trunc);
        }
        file_.write(piece.data().data(), static_cast<std::streamsize>(piece.data().size()));
        if (!piece.remark().empty()) remark_ = piece.remark();
        if (!piece.last_of_file() && file_) return absl::OkStatus();
        file_.close();
        std::error_code error;
        if (file_) fs::rename(aside_, target_, error);
        if (!file_ || error) {
            fs::remove(aside_, error);
            return absl::UnavailableError(
                fmt::format("{}: cannot be written; correct the path or make room", target_.string()));
        }
        ++written_;
        return absl::OkStatus();
    }

    int written() const { return written_; }
    const std::string& remark() const { return remark_; }
    // Of a file that never ended.
    ~PieceFiles() {
        if (!file_.is_open()) return;
        file_.close();
        std::error_code ignored;
        fs::remove(aside_, ignored);
    }

  private:
    fs::path out_, target_, aside_;
    bool many_;
    std::ofstream file_;
    std::string remark_;
    int written_ = 0;
};

absl::Status run_export(const Common& common, const ExportOptions& options) {
    if (options.format.empty() && !options.anonymous)
        return absl::InvalidArgumentError("--format is required");
    const auto format = format_of(options.format.empty() ? "session" : options.format);
    if (!format.ok()) return format.status();
    v1::ExportRequest request;
    request.set_recording(options.session);
    request.set_format(*format);
    request.set_turn_deg(options.turn_deg);
    request.set_hold(options.hold);
    request.set_camera(options.camera);
    request.set_width_px(options.width_px);
    request.set_anonymous(options.anonymous);
    if (!options.frames.empty()) {
        long long first = 0, last = 0;
        char rest = 0;
        if (std::sscanf(options.frames.c_str(), "%15lld-%15lld%c", &first, &last, &rest) != 2 || first < 0 ||
            last <= first)
            return absl::InvalidArgumentError(
                fmt::format("--frames is '{}'; give FIRST-LAST", options.frames));
        request.set_first_frame(first);
        request.set_last_frame(last);
    }
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.max_silence = std::chrono::milliseconds(static_cast<std::int64_t>(options.wait_s * 1000));
    PieceFiles files(options.out, *format == v1::EXPORT_FORMAT_PLY || *format == v1::EXPORT_FORMAT_SESSION);
    absl::Status written;
    const auto add = [&](const v1::ExportResponse& piece) {
        written = files.add(piece);
        return written.ok();
    };
    absl::Status status;
    {
        ProgressLine line(common.json);
        const auto show = [&line](double share) { line.show(share); };
        status = client::Client(common.client_options()).export_recording(request, add, show, stream);
    }
    if (!written.ok()) return written;
    if (!status.ok()) return status;
    if (common.json)
        print_line(nlohmann::ordered_json({{"files", files.written()}, {"remark", files.remark()}}).dump());
    else
        print_line(fmt::format("{} file{} in {}{}", files.written(), files.written() == 1 ? "" : "s",
                               options.out.string(), files.remark().empty() ? "" : "; " + files.remark()));
    return absl::OkStatus();
}

}  // namespace

bool exports_recording(const std::vector<std::string>& arguments) {
    return std::ranges::any_of(arguments, [](const std::string& argument) {
        return argument == "--session" || argument.starts_with("--session=");
    });
}

void add_export_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<ExportOptions>();
    CLI::App* verb = add_action(
        app, common, run, options, "export",
        "A daemon's recording, or what `kinevox process` wrote, in another program's format", run_export);
    verb->footer("On files, without a daemon: `kinevox export FOLDER --format FORMAT --out FILE`.");
    verb->add_option("--session", options->session, "The recording, as `kinevox record list` shows it")
        ->required();
    verb->add_option("--format", options->format,
                     "trc, mot (OpenSim), c3d, bvh, csv, ply (a folder of volumes) or mp4 (pictures "
                     "with the skeleton); session: a folder to pass on, with "
                     "--anonymous, where it is the default")
        ->check(CLI::IsMember({"trc", "mot", "c3d", "bvh", "csv", "ply", "mp4", "session"}));
    verb->add_flag("--anonymous", options->anonymous,
                   "Nothing by which the person can be seen or named: silhouettes for pictures, no colours, "
                   "no names, no date");
    verb->add_option("--out", options->out, "The file to write; of ply and session the folder")->required();
    verb->add_option("--frames", options->frames, "A part of it, FIRST-LAST, both included");
    verb->add_option("--turn", options->turn_deg, "About the vertical, degrees, anticlockwise from above")
        ->check(CLI::Range(-360.0, 360.0));
    verb->add_flag("--hold", options->hold, "bvh: where a value is withheld, repeat the last measured one");
    verb->add_option("--camera", options->camera, "mp4: this camera's pictures; else all of them in tiles");
    verb->add_option("--width", options->width_px, "mp4: of the film, px; 0: 1280 at most")
        ->check(CLI::Range(0, 8192));
    verb->add_option("--wait", options->wait_s,
                     "Seconds in which the daemon must say something: the exports before this one come first")
        ->check(CLI::Range(1.0, 86400.0))
        ->capture_default_str();
}

}  // namespace kinevox::cli
