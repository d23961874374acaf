#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "common/export_options.h"
#include "common/progress_line.h"

namespace kinevox::cli {
namespace {

namespace fs = std::filesystem;

struct ExportOptions {
    std::string name, format, range, camera;
    fs::path out;
    double yaw_deg = 0, idle_timeout_s = 600;
    int width_px = 0;
    std::uint32_t subject_id = 0;
    bool hold_withheld = false, anonymous = false, overwrite = false;
};

// The received files, each written atomically: to a temporary file that is renamed when it is complete.
class ReceivedFiles {
  public:
    ReceivedFiles(fs::path out, bool folder) : out_(std::move(out)), folder_(folder) {}
    ~ReceivedFiles() {  // of a file that was not completed
        if (!file_.is_open()) return;
        file_.close();
        std::error_code ignored;
        fs::remove(temporary_, ignored);
    }

    absl::Status add(const v1::ExportRecordingResponse& chunk) {
        if (!file_.is_open()) {
            const fs::path name = fs::path(chunk.file_name()).filename();  // nothing leads out of the folder
            target_ = folder_ ? out_ / name : out_;
            std::error_code error;
            if (target_.has_parent_path()) fs::create_directories(target_.parent_path(), error);
            temporary_ = target_.string() + ".part";
            file_.open(temporary_, std::ios::binary | std::ios::trunc);
        }
        file_.write(chunk.data().data(), static_cast<std::streamsize>(chunk.data().size()));
        if (!chunk.warning().empty()) warning_ = chunk.warning();
        if (!chunk.last_chunk() && file_) return absl::OkStatus();
        file_.close();
        std::error_code error;
        if (file_) fs::rename(temporary_, target_, error);
        if (!file_ || error) {
            fs::remove(temporary_, error);
            return absl::UnavailableError(
                fmt::format("{}: cannot be written; correct the path or free disk space", target_.string()));
        }
        ++count_;
        return absl::OkStatus();
    }

    std::uint64_t count() const { return count_; }
    const std::string& warning() const { return warning_; }

  private:
    fs::path out_, target_, temporary_;
    bool folder_;
    std::ofstream file_;
    std::string warning_;
    std::uint64_t count_ = 0;
};

const ExportFormatInfo& format_of(const ExportOptions& options) {
    return *find_export_format(options.format.empty() ? "session" : options.format);  // checked when parsed
}

absl::StatusOr<v1::ExportRecordingRequest> request_of(const ExportOptions& options) {
    if (options.format.empty() && !options.anonymous)
        return absl::InvalidArgumentError("--format is required; see kinevox record export --help");
    v1::ExportRecordingRequest request;
    request.set_name(options.name);
    request.set_format(static_cast<v1::ExportFormat>(format_of(options).format));
    request.set_yaw_deg(options.yaw_deg);
    request.set_hold_withheld(options.hold_withheld);
    request.set_camera(options.camera);
    request.set_width_px(options.width_px);
    request.set_anonymous(options.anonymous);
    request.set_subject_id(options.subject_id);
    if (options.range.empty()) return request;
    const auto range = parse_frame_range(options.range);
    if (!range)
        return absl::InvalidArgumentError(
            fmt::format("--range is '{}'; write FIRST-LAST, for example 30-89", options.range));
    request.set_first_frame(range->first);
    if (range->last) request.set_last_frame(*range->last);
    return request;
}

absl::Status run_export(const GlobalOptions& global, const ExportOptions& options) {
    const auto request = request_of(options);
    if (!request.ok()) return request.status();
    if (absl::Status free = check_overwrite(options.overwrite, options.out.string()); !free.ok()) return free;
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.idle_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(options.idle_timeout_s * 1000));
    ReceivedFiles files(options.out, format_of(options).many_files);
    absl::Status written;
    const auto add = [&](const v1::ExportRecordingResponse& chunk) {
        written = files.add(chunk);
        return written.ok();
    };
    absl::Status status;
    {
        ProgressLine line(global.json);
        const auto show = [&line](double progress) { line.show(progress); };
        status = client::Client(global.client_options()).export_recording(*request, add, show, stream);
    }
    if (!written.ok()) return written;
    if (!status.ok()) return status;
    if (global.json)
        print_line(
            nlohmann::ordered_json(
                {{"file_count", files.count()}, {"out", options.out.string()}, {"warning", files.warning()}})
                .dump());
    else
        print_line(fmt::format("{} in {}{}", count_of(files.count(), "file"), options.out.string(),
                               files.warning().empty() ? "" : "; " + files.warning()));
    return absl::OkStatus();
}

}  // namespace

void add_record_export_verb(CLI::App& record, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<ExportOptions>();
    CLI::App* command = add_action(record, global, run, options, "export",
                                   "Export a recording to TRC, MOT, C3D, BVH, CSV, PLY or MP4", run_export);
    command->add_option("NAME", options->name, "Name shown by `kinevox record list`")->required();
    std::vector<std::string> formats;
    for (const ExportFormatInfo& info : kExportFormats) formats.emplace_back(info.name);
    command
        ->add_option("--format", options->format,
                     "trc, mot (OpenSim), c3d, bvh, csv, ply (folder of volumes), mp4 (images with the "
                     "skeleton) or session (folder to pass on; the default with --anonymous)")
        ->check(CLI::IsMember(formats));
    command->add_option("--out", options->out, "Output file (ply, session: folder)")->required();
    add_overwrite_option(*command, options->overwrite);
    command->add_flag("--anonymous", options->anonymous,
                      "Remove images, colours, names and dates; show silhouettes instead");
    command->add_option("--range", options->range, "Frames to export, FIRST-LAST (inclusive)");
    command->add_option("--subject", options->subject_id,
                        "Subject to export (id; default: the only one; ply, mp4: all)");
    command
        ->add_option(
            "--yaw", options->yaw_deg,
            "Rotation about the vertical (deg, counter-clockwise from above); OpenSim models face +x")
        ->check(CLI::Range(-360.0, 360.0));
    command->add_flag("--hold-withheld", options->hold_withheld,
                      "BVH: repeat the last value where one is withheld");
    command->add_option("--camera", options->camera, "MP4: camera to show (default: all, tiled)");
    command->add_option("--video-width", options->width_px, "MP4: video width (px; default: up to 1280)")
        ->check(CLI::Range(0, 8192));
    command
        ->add_option("--idle-timeout", options->idle_timeout_s,
                     "Time to wait for the next message (s); queued exports run first")
        ->check(CLI::Range(1.0, 86400.0))
        ->capture_default_str();
}

}  // namespace kinevox::cli
