#include "server/recording/recording_export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <system_error>
#include <utility>

#include "common/files.h"
#include "common/geometry.h"
#include "common/one_line.h"
#include "common/session_file.h"
#include "common/toml_reader.h"
#include "common/volume.h"
#include "server/cameras/session_files.h"
#include "server/recording/anonymous_export.h"
#include "server/recording/subject_names.h"
#include "server/recording/trial_formats.h"
#include "server/recording/volume_file.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

// The folder of the tables, and their session.
struct ExportSource {
    fs::path tables;
    std::optional<Session> session;
};

// The session named by run.toml in a folder of results.
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

absl::StatusOr<ExportSource> find_source(const fs::path& from, ExportFormat format) {
    std::error_code error;
    const fs::path file = fs::is_directory(from, error) ? from / "session.toml" : from;
    if (fs::is_regular_file(file, error)) {
        repair_recording(file).IgnoreError();
        auto session = read_session(file);
        if (!session.ok()) return session.status();
        if (!session->recording || session->recording->poses.empty())
            return absl::FailedPreconditionError(fmt::format(
                "{}: contains no poses; run `kinevox process` and export its results", file.string()));
        return ExportSource{session->recording->poses, *std::move(session)};
    }
    ExportSource source{from, {}};
    if (format != ExportFormat::kMp4 && format != ExportFormat::kSession) return source;
    auto session = session_of_results(from);
    if (!session.ok()) return session.status();
    source.session = *std::move(session);
    return source;
}

// OpenSim's models limit the pelvis' rotation to 90 deg to either side of x.
std::string clamp_warning(const AngleRange& range, double yaw_rad) {
    const double min = degrees(range.min_rad), max = degrees(range.max_rad);
    if (min >= -90 && max <= 90) return {};
    std::string warning = fmt::format(
        "pelvis_rotation ranges from {:.0f} to {:.0f} deg, but OpenSim's models clamp it at 90", min, max);
    if (max - min < 170)
        warning += fmt::format("; --yaw {:.0f} avoids that",
                               std::remainder(degrees(yaw_rad) - (min + max) / 2, 360.0));
    return warning;
}

// The bytes of a format that is a single file, and a warning.
using TrialWriter = absl::StatusOr<std::string> (*)(const Trial& trial, const ExportOptions& options,
                                                    const fs::path& out, std::string& warning);

absl::StatusOr<std::string> write_bvh(const Trial& trial, const ExportOptions& options, const fs::path&,
                                      std::string& warning) {
    BvhGaps gaps;
    auto text = bvh_file(trial, options.hold_withheld, &gaps);
    std::vector<std::string> parts;
    if (gaps.held_frames > 0)
        parts.push_back(fmt::format("{} frames repeat a value that was withheld", gaps.held_frames));
    if (gaps.bridged_frames > 0)
        parts.push_back(fmt::format("{} lost frames repeat the one before", gaps.bridged_frames));
    warning = fmt::format("{}", fmt::join(parts, "; "));
    return text;
}

absl::StatusOr<std::string> write_mot(const Trial& trial, const ExportOptions& options, const fs::path&,
                                      std::string& warning) {
    auto text = mot_file(trial);
    if (text.ok()) warning = clamp_warning(mot_pelvis_rotation(trial), options.yaw_rad);
    return text;
}

// Null: the format has a writer of its own in export_recording().
TrialWriter writer_of(ExportFormat format) {
    switch (format) {
        case ExportFormat::kTrc:
            return [](const Trial& trial, const ExportOptions&, const fs::path& out,
                      std::string&) -> absl::StatusOr<std::string> {
                return trc_file(trial, out.filename().string());
            };
        case ExportFormat::kMot:
            return write_mot;
        case ExportFormat::kC3d:
            return [](const Trial& trial, const ExportOptions&, const fs::path&, std::string&) {
                return c3d_file(trial);
            };
        case ExportFormat::kBvh:
            return write_bvh;
        case ExportFormat::kCsv:
            return [](const Trial& trial, const ExportOptions&, const fs::path&,
                      std::string&) -> absl::StatusOr<std::string> { return csv_file(trial); };
        case ExportFormat::kPly:
        case ExportFormat::kMp4:
        case ExportFormat::kSession:
            break;
    }
    return nullptr;
}

bool is_wanted(const VolumeFileReader::Entry& entry, std::uint32_t subject_id) {
    return subject_id == 0 || entry.subject_id == 0 || entry.subject_id == subject_id;
}

// As `kinevox process` names them: FRAME.ply of the first or the chosen subject, FRAME_sID.ply of others.
absl::StatusOr<ExportedFiles> write_volumes(const fs::path& file, const ExportOptions& options,
                                            const fs::path& out, const JobControl& work) {
    if (options.yaw_rad != 0)
        return absl::InvalidArgumentError(
            "volumes cannot be rotated; omit the yaw, or rotate the points in the program that reads them");
    const auto volumes = VolumeFileReader::open(file);
    if (!volumes.ok()) return volumes.status();
    ExportedFiles written;
    std::int64_t latest_frame = -1;
    std::size_t started = 0;
    for (const VolumeFileReader::Entry& entry : volumes->entries()) {
        work.report(static_cast<double>(started++) / static_cast<double>(volumes->entries().size()));
        if (work.stop) return absl::CancelledError("the export was stopped");
        const auto frame = static_cast<std::int64_t>(entry.frame);
        if (frame < options.first_frame || frame > options.last_frame.value_or(frame)) continue;
        if (entry.bytes == 0 || !is_wanted(entry, options.subject_id)) continue;
        auto volume = volumes->read(entry);
        if (!volume.ok()) return volume.status();
        if (options.anonymous) volume->colours.clear();
        const bool named = !entry.first_of_frame && options.subject_id == 0;
        const fs::path target = out / (named ? fmt::format("{:06}_s{}.ply", entry.frame, entry.subject_id)
                                             : fmt::format("{:06}.ply", entry.frame));
        if (absl::Status done = write_volume_ply(*volume, target); !done.ok()) return done;
        written.files.push_back(target);
        if (std::exchange(latest_frame, frame) != frame) ++written.frames;
    }
    if (written.files.empty())
        return absl::OutOfRangeError(
            options.subject_id == 0
                ? fmt::format("{}: no subject was tracked in these frames; change the range", file.string())
                : fmt::format("{}: subject {} has no volume in these frames; change the range or the subject",
                              file.string(), options.subject_id));
    return written;
}

// The names of the subjects next to their volumes; nothing without names.
absl::Status add_names(const fs::path& tables, const fs::path& out, ExportedFiles& written) {
    const auto names = read_subject_names(tables);
    if (!names.ok()) return names.status();
    if (names->empty()) return absl::OkStatus();
    written.files.push_back(out / kSubjectNamesFile);
    return write_file_atomically(written.files.back(), subject_names_csv(*names));
}

// The others are of one skeleton.
bool shows_every_subject(ExportFormat format) {
    return format == ExportFormat::kMp4 || format == ExportFormat::kSession;
}

absl::StatusOr<MeasuredTrials> read_measured(const ExportSource& source, const ExportOptions& options) {
    const double fps = source.session ? source.session->fps : 0;
    MeasuredTrials measured;
    const auto subjects = subjects_of_trial(source.tables);
    if (subjects.ok()) measured.max_at_once = subjects->max_at_once;
    if (subjects.ok() && shows_every_subject(options.format) && options.subject_id == 0) {
        auto trials = read_trials(source.tables, fps, *subjects);
        if (!trials.ok()) return trials.status();
        measured.trials = *std::move(trials);
    } else {  // which says what is wrong with the tables
        auto trial = read_trial(source.tables, fps, options.subject_id);
        if (!trial.ok()) return trial.status();
        measured.trials.push_back(*std::move(trial));
    }
    for (Trial& trial : measured.trials) {
        if (source.session && source.session->recording) trial.name = source.session->name;
        if (options.anonymous) trial.name = kAnonymous, trial.subject_name.clear();
    }
    return measured;
}

absl::Status check_session_options(const ExportOptions& options) {
    if (!options.anonymous)
        return absl::InvalidArgumentError(
            "format session requires anonymous; set it, or copy the recording's folder");
    if (options.first_frame > 0 || options.last_frame || options.yaw_rad != 0 || !options.camera.empty())
        return absl::InvalidArgumentError(
            "format session exports all frames and cameras; omit range, yaw and camera");
    if (options.subject_id != 0)
        return absl::InvalidArgumentError("format session exports all subjects; omit the subject");
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<ExportedFiles> export_recording(const fs::path& from, const ExportOptions& options,
                                               const fs::path& out, const JobControl& work) {
    if (options.format == ExportFormat::kSession)
        if (absl::Status valid = check_session_options(options); !valid.ok()) return valid;
    const auto source = find_source(from, options.format);
    if (!source.ok()) return source.status();
    if (options.format == ExportFormat::kPly) {
        if (!source->session || source->session->recording->volumes.empty())
            return absl::FailedPreconditionError(fmt::format(
                "{}: contains no volumes; `kinevox process --save volumes` writes them", from.string()));
        auto written = write_volumes(source->session->recording->volumes, options, out, work);
        if (!written.ok() || options.anonymous) return written;
        if (absl::Status named = add_names(source->tables, out, *written); !named.ok()) return named;
        return written;
    }
    const auto measured = read_measured(*source, options);
    if (!measured.ok()) return measured.status();
    std::vector<Trial> trials = measured->trials;
    if (options.first_frame > 0 || options.last_frame)
        for (Trial& trial : trials) {
            auto slice =
                slice_trial(trial, options.first_frame, options.last_frame.value_or(trial.frames.back()));
            if (!slice.ok()) return slice.status();
            trial = *std::move(slice);
        }
    if (options.anonymous && source->session && shows_every_subject(options.format))
        return export_anonymous(*source->session, *measured, trials, options, out, work);
    Trial* const trial = &trials.front();
    ExportedFiles written;
    written.files.push_back(out);
    written.frames = static_cast<std::int64_t>(trial->size());
    written.rate_hz = trial->rate_hz;
    if (options.format == ExportFormat::kMp4) {
        if (absl::Status done =
                write_overlay_video(*source->session, trials, {options.camera, options.width_px}, out, work);
            !done.ok())
            return done;
        return written;
    }
    if (options.yaw_rad != 0) rotate_trial(*trial, options.yaw_rad);
    const TrialWriter writer = writer_of(options.format);
    if (!writer) return absl::InvalidArgumentError("unknown export format");
    const auto bytes = writer(*trial, options, out, written.warning);
    if (!bytes.ok()) return bytes.status();
    if (trial->max_time_snap_s > 0 && written.warning.empty())
        written.warning =
            fmt::format("irregular frame times were snapped to the frame grid by up to {:.0f} ms",
                        1000 * trial->max_time_snap_s);
    if (absl::Status done = write_file_atomically(out, *bytes); !done.ok()) return done;
    return written;
}

absl::StatusOr<ExportedFiles> export_each_subject(const fs::path& from, const ExportOptions& options,
                                                  const fs::path& out, const JobControl& work) {
    const ExportFormatInfo* const format = find_export_format(options.format);
    if (!format || format->many_files)
        return absl::InvalidArgumentError(fmt::format("format {} contains all subjects; omit --each-subject",
                                                      format ? format->name : "unknown"));
    if (options.subject_id != 0)
        return absl::InvalidArgumentError("all subjects are exported; omit --subject or --each-subject");
    const auto source = find_source(from, options.format);
    if (!source.ok()) return source.status();
    const auto subjects = subjects_of_trial(source->tables);
    if (!subjects.ok()) return subjects.status();
    const auto names = read_subject_names(source->tables);
    if (!names.ok()) return names.status();
    if (subjects->ids.empty())
        return absl::FailedPreconditionError(fmt::format(
            "{}: no subject has a measured joint; there is nothing to export", source->tables.string()));
    ExportedFiles all;
    for (std::size_t n = 0; n < subjects->ids.size(); ++n) {
        ExportOptions own = options;
        own.subject_id = subjects->ids[n];
        const std::string file = subject_file_name(
            own.subject_id, options.anonymous ? std::string() : subject_name(*names, own.subject_id));
        const double count = static_cast<double>(subjects->ids.size()), done = static_cast<double>(n);
        const auto written = export_recording(from, own, out / fmt::format("{}.{}", file, format->name),
                                              work.subrange(done / count, (done + 1) / count));
        if (!written.ok())
            return absl::Status(
                written.status().code(),
                fmt::format("subject {}: {}", own.subject_id, std::string(written.status().message())));
        all.files.insert(all.files.end(), written->files.begin(), written->files.end());
        all.frames = std::max(all.frames, written->frames);
        all.rate_hz = written->rate_hz;
        if (!written->warning.empty())
            all.warning += fmt::format("{}subject {}: {}", all.warning.empty() ? "" : "; ", own.subject_id,
                                       written->warning);
    }
    return all;
}

}  // namespace kinevox
