#include "server/recording/recording_export.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <system_error>
#include <utility>

#include "common/atomic_file.h"
#include "common/degrees.h"
#include "common/one_line.h"
#include "common/ply.h"
#include "common/session_file.h"
#include "common/toml_reader.h"
#include "server/cameras/recorded_session.h"
#include "server/recording/anonymous_export.h"
#include "server/recording/anonymous_session.h"
#include "server/recording/overlay_film.h"
#include "server/recording/trial_formats.h"
#include "server/recording/volume_file.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

// Where the tables lie, and the session that they are of.
struct ExportSource {
    fs::path tables;
    std::optional<Session> session;
};

// The session that a folder of results names in its run.toml.
absl::StatusOr<Session> session_of_results(const fs::path& folder) {
    const fs::path file = folder / "run.toml";
    const auto text = read_file(file);
    if (!text.ok()) return text.status();
    const auto document = TomlDocument::parse(*text, file.string());
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    const std::string session = root.text("session");
    for (const std::string& key : root.keys()) root.ignore(key);
    if (absl::Status read = (*document)->finish(); !read.ok()) return read;
    auto read = read_session(session);
    if (read.ok()) return read;
    const std::string why(read.status().message());
    return absl::Status(read.status().code(), one_line(fmt::format("{}: session: {}", file.string(), why)));
}

absl::StatusOr<ExportSource> find_source(const fs::path& from, const std::string& format) {
    std::error_code error;
    const fs::path file = fs::is_directory(from, error) ? from / "session.toml" : from;
    if (fs::is_regular_file(file, error)) {
        repair_recording(file).IgnoreError();
        auto session = read_session(file);
        if (!session.ok()) return session.status();
        if (!session->recording || session->recording->poses.empty())
            return absl::FailedPreconditionError(
                fmt::format("{}: no poses were recorded with it; export what `kinevox process` makes of it",
                            file.string()));
        return ExportSource{session->recording->poses, *std::move(session)};
    }
    ExportSource source{from, {}};
    if (format != "mp4" && format != "session") return source;
    auto session = session_of_results(from);
    if (!session.ok()) return session.status();
    source.session = *std::move(session);
    return source;
}

// OpenSim's models let the pelvis turn 90 deg to either side of x.
std::string clamped_remark(const AngleRange& range, double turn_rad) {
    const double least = degrees(range.min_rad), most = degrees(range.max_rad);
    if (least >= -90 && most <= 90) return {};
    std::string remark = fmt::format(
        "pelvis_rotation goes from {:.0f} to {:.0f} deg, but OpenSim's models clamp it at 90", least, most);
    if (most - least < 170)
        remark += fmt::format(": --turn {:.0f} avoids that",
                              std::remainder(degrees(turn_rad) - (least + most) / 2, 360.0));
    return remark;
}

absl::StatusOr<std::string> text_of(const Trial& trial, const ExportOptions& options, const fs::path& out,
                                    std::string& remark) {
    if (options.format == "trc") return trc_file(trial, out.filename().string());
    if (options.format == "c3d") return c3d_file(trial);
    if (options.format == "csv") return csv_file(trial);
    if (options.format == "bvh") {
        std::int64_t held = 0;
        auto text = bvh_file(trial, options.hold, &held);
        if (held > 0) remark = fmt::format("{} frames repeat a value that was withheld", held);
        return text;
    }
    auto text = mot_file(trial);
    if (text.ok()) remark = clamped_remark(mot_pelvis_rotation(trial), options.turn_rad);
    return text;
}

absl::StatusOr<ExportedFiles> write_volumes(const fs::path& file, const ExportOptions& options,
                                            const fs::path& out, const LongWork& work) {
    if (options.turn_rad != 0)
        return absl::InvalidArgumentError(
            "volumes are not turned; leave the turn out, or turn the points in their program");
    const auto volumes = VolumeFileReader::open(file);
    if (!volumes.ok()) return volumes.status();
    ExportedFiles written;
    std::size_t begun = 0;
    for (const VolumeFileReader::Entry& entry : volumes->entries()) {
        work.tell(static_cast<double>(begun++) / static_cast<double>(volumes->entries().size()));
        if (work.stop) return absl::CancelledError("the export was stopped");
        const auto frame = static_cast<std::int64_t>(entry.frame);
        if (frame < options.first_frame || (options.last_frame >= 0 && frame > options.last_frame)) continue;
        auto volume = volumes->read(entry);
        if (!volume.ok()) return volume.status();
        if (options.anonymous) volume->colours.clear();
        const fs::path target = out / fmt::format("{:06}.ply", entry.frame);
        if (absl::Status done = write_volume_ply(*volume, target); !done.ok()) return done;
        written.files.push_back(target);
    }
    if (written.files.empty())
        return absl::OutOfRangeError(
            fmt::format("{}: nobody was tracked in these frames; give others", file.string()));
    written.frames = static_cast<std::int64_t>(written.files.size());
    return written;
}

absl::Status check_session_options(const ExportOptions& options) {
    if (!options.anonymous)
        return absl::InvalidArgumentError(
            "a session is exported anonymous only; add that, or copy the recording's folder");
    if (options.first_frame > 0 || options.last_frame >= 0 || options.turn_rad != 0 ||
        !options.camera.empty())
        return absl::InvalidArgumentError("a session is exported whole; leave frames, turn and camera out");
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<ExportedFiles> export_recording(const fs::path& from, const ExportOptions& options,
                                               const fs::path& out, const LongWork& work) {
    if (std::ranges::find(kExportFormats, options.format) == std::end(kExportFormats))
        return absl::InvalidArgumentError(fmt::format("there is no format \"{}\"", options.format));
    if (options.format == "session")
        if (absl::Status asked = check_session_options(options); !asked.ok()) return asked;
    const auto source = find_source(from, options.format);
    if (!source.ok()) return source.status();
    if (options.format == "ply") {
        if (!source->session || source->session->recording->volumes.empty())
            return absl::FailedPreconditionError(fmt::format(
                "{}: no volumes were recorded with it; `kinevox process --save volumes` writes them",
                from.string()));
        return write_volumes(source->session->recording->volumes, options, out, work);
    }
    auto trial = read_trial(source->tables, source->session ? source->session->fps : 0);
    if (!trial.ok()) return trial.status();
    if (source->session && source->session->recording) trial->name = source->session->name;
    if (options.anonymous) trial->name = kAnonymous;
    const Trial whole = options.anonymous ? *trial : Trial{};
    if (options.first_frame > 0 || options.last_frame >= 0) {
        const std::int64_t last = options.last_frame >= 0 ? options.last_frame : trial->frames.back();
        trial = part_of_trial(*trial, options.first_frame, last);
        if (!trial.ok()) return trial.status();
    }
    if (options.anonymous && source->session)
        if (options.format == "mp4" || options.format == "session")
            return export_anonymous(*source->session, whole, *trial, options, out, work);
    ExportedFiles written;
    written.files.push_back(out);
    written.frames = static_cast<std::int64_t>(trial->size());
    written.rate_hz = trial->rate_hz;
    if (options.format == "mp4") {
        if (absl::Status done =
                write_overlay_film(*source->session, *trial, {options.camera, options.width_px}, out, work);
            !done.ok())
            return done;
        return written;
    }
    if (options.turn_rad != 0) turn_trial(*trial, options.turn_rad);
    const auto bytes = text_of(*trial, options, out, written.remark);
    if (!bytes.ok()) return bytes.status();
    if (trial->max_beside_s > 0 && written.remark.empty())
        written.remark = fmt::format("the cameras' beat was not even: times are moved by {:.0f} ms at most",
                                     1000 * trial->max_beside_s);
    if (absl::Status done = write_file_atomically(out, *bytes); !done.ok()) return done;
    return written;
}

}  // namespace kinevox
