#include "server/tools/process/process.h"

#include <fmt/format.h>

#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/session_file.h"
#include "server/cameras/session_source.h"
#include "server/pose/body_fitter.h"
#include "server/pose/pose_stage.h"
#include "server/tools/process/quality_pass.h"
#include "server/tools/process/run_report.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
}

absl::Status learn_background(FrameSource& source, Pipeline& pipeline,
                              const std::filesystem::path& session_file) {
    const auto background = background_of_all(source, session_file);
    if (!background.ok()) return background.status();
    return pipeline.learn_background(*background);
}

// One frame set does not determine a body, and a pose found in few of them is doubtful.
constexpr int kMinBodyFrameSets = 5;

// The body of the subject in a session, fitted to all of its frame sets. None if a subject is there, but too
// few poses: a warning is printed, and the body is fitted to the trial's movement instead.
absl::StatusOr<std::optional<BodyShape>> body_of_session(const std::filesystem::path& session_file,
                                                         const ProcessOptions& options,
                                                         const std::atomic<bool>& stop) {
    auto source = open_session_source(session_file);
    if (!source.ok()) return source.status();
    auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), options.pipeline);
    if (!pipeline.ok()) return pipeline.status();
    if (absl::Status learned = learn_background(**source, **pipeline, session_file); !learned.ok())
        return learned;
    std::vector<std::unique_ptr<PoseObservation>> frames;
    const auto max_frames = static_cast<std::size_t>(options.poses.body_seconds * (*source)->fps()) + 1;
    while (frames.size() < max_frames && !stop) {
        auto frame_set = (*source)->next();
        if (absl::IsOutOfRange(frame_set.status())) break;
        if (!frame_set.ok()) return frame_set.status();
        auto result = (*pipeline)->process(std::move(*frame_set));
        if (!result.ok()) return result.status();
        if (const SubjectResult* const subject = (*result)->first_subject(); subject && subject->volume)
            frames.push_back(std::make_unique<PoseObservation>((*pipeline)->pose_stage()->observation()));
    }
    std::vector<const PoseObservation*> observations;
    for (const auto& frame : frames) observations.push_back(frame.get());
    const auto fit = fit_body((*source)->cameras(), (*source)->fps(), observations,
                              options.pipeline.posing.body, options.pipeline.posing, options.poses.body);
    if (fit.ok() && fit->frame_set_count >= kMinBodyFrameSets) return fit->shape;
    const std::string why = fmt::format(
        "{}: {}", session_file.string(),
        fit.ok() ? fmt::format("the subject's pose was found in {} of {} frame sets, {} are needed",
                               fit->frame_set_count, observations.size(), kMinBodyFrameSets)
                 : std::string(fit.status().message()));
    if (observations.empty()) return absl::FailedPreconditionError(why);
    fmt::print(stderr, "kinevox process: {}; the body is fitted to the movement instead\n", why);
    return std::nullopt;
}

// The files of the calibration's certificate, if it has one: they belong to the results.
std::vector<Table> certificate_tables(const std::filesystem::path& session_file) {
    std::vector<Table> tables;
    const auto session = read_session(session_file);
    if (!session.ok()) return tables;
    for (const auto& [ending, name] : {std::pair{".certificate.json", "calibration.certificate.json"},
                                       std::pair{".certificate.png", "calibration.certificate.png"}}) {
        auto file = session->calibration;
        if (auto text = read_file(file.replace_extension(ending), 64 << 20); text.ok())
            tables.push_back({name, *std::move(text)});
    }
    return tables;
}

// Of the poses, and body_N.toml of each subject N with a pose, the first also as body.toml.
std::vector<Table> tables_of(const std::vector<PoseRow>& rows, const PosePass& poses) {
    std::vector<Table> tables = pose_tables(rows);
    if (!poses.body()) return tables;
    std::set<std::uint32_t> subjects;
    for (const PoseRow& row : rows)
        if (row.pose && row.subject_id) subjects.insert(row.subject_id);
    tables.push_back({"body.toml", body_shape_toml(*poses.body())});
    for (const std::uint32_t id : subjects)
        if (const BodyShape* const body = poses.body_of(id))
            tables.push_back({fmt::format("body_{}.toml", id), body_shape_toml(*body)});
    return tables;
}

}  // namespace

absl::Status process_session(const ProcessOptions& requested, const std::atomic<bool>& stop) {
    ProcessOptions options = requested;
    const auto fingerprint = run_fingerprint(options);
    if (!fingerprint.ok()) return fingerprint.status();
    if (options.resume && holds_results_of(options.out_folder, *fingerprint)) {
        if (!options.quiet)
            fmt::print("{} already holds these results; skipped\n", options.out_folder.string());
        return absl::OkStatus();
    }
    if (std::error_code error;
        !options.overwrite && std::filesystem::exists(options.out_folder / "run.toml", error))
        return absl::AlreadyExistsError(fmt::format(
            "{}: holds other results; add --overwrite or change --out", options.out_folder.string()));
    if (!options.tpose_file.empty() && options.pipeline.pose) {
        auto body = body_of_session(options.tpose_file, options, stop);
        if (!body.ok()) return body.status();
        options.poses.fit_body = !*body;
        if (*body) options.pipeline.posing.body = **body;
    }
    SessionSourceOptions source_options;
    source_options.decode_in_bursts = options.decode_in_bursts;
    auto source = open_session_source(options.session_file, source_options);
    if (!source.ok()) return source.status();
    const double fps = (*source)->fps() / options.every;
    auto pipeline = Pipeline::create((*source)->cameras(), fps, options.pipeline);
    if (!pipeline.ok()) return pipeline.status();
    std::vector<std::string> names;
    for (const Camera& camera : (*source)->cameras()) names.push_back(camera.name);
    auto writer = ResultWriter::create(options.out_folder, names, options.writer);
    if (!writer.ok()) return writer.status();
    const auto background = background_of_all(**source, options.session_file);
    if (!background.ok()) return background.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;

    const bool posing = (*pipeline)->pose_stage() != nullptr;
    PosePass poses((*source)->cameras(), fps, options.pipeline, options.poses);
    QualityPass quality(options.session_file, (*source)->cameras(), *background);
    RunSummary summary;
    const Clock::time_point start = Clock::now();
    {
        std::int64_t total = (*source)->frame_count();
        if (total > 0) total = (total + options.every - 1) / options.every;
        if (options.max_frames > 0 && (total < 0 || total > options.max_frames)) total = options.max_frames;
        ProgressBar bar(total, options.quiet);
        for (std::int64_t n = 0; options.max_frames == 0 || summary.frames() < options.max_frames; ++n) {
            if (stop)
                return absl::CancelledError(
                    fmt::format("stopped after {} frame sets; nothing was written", summary.frames()));
            const Clock::time_point requested_at = Clock::now();
            auto frame_set = (*source)->next();
            if (absl::IsOutOfRange(frame_set.status())) break;
            if (!frame_set.ok()) return frame_set.status();
            if (n % options.every != 0) continue;
            frame_set->decode_ms = 1000 * seconds_since(requested_at);
            auto result = (*pipeline)->process(std::move(*frame_set));
            if (!result.ok()) return result.status();
            summary.add(**result);
            if (posing) poses.add(**result, **pipeline);
            quality.add(**result);
            if (absl::Status added = (*writer)->add(std::move(*result)); !added.ok()) return added;
            bar.show(summary.frames());
        }
    }
    const double wall_s = seconds_since(start);
    (*writer)->add_table({"calibration.toml", calibration_toml((*source)->cameras())});
    for (Table& table : certificate_tables(options.session_file)) (*writer)->add_table(std::move(table));
    const std::vector<PoseRow> rows = posing ? poses.finish(**pipeline) : std::vector<PoseRow>{};
    if (posing)
        for (Table& table : tables_of(rows, poses)) (*writer)->add_table(std::move(table));
    const quality::QualityReport report = quality.finish(posing ? &poses : nullptr, rows);
    (*writer)->add_table({"quality.json", quality::quality_json(report)});
    (*writer)->add_table({"run.toml", run_toml(options, *fingerprint, fps, summary.frames())});  // the last
    if (absl::Status finished = (*writer)->finish(); !finished.ok()) return finished;
    if (!options.quiet) {
        fmt::print("{}results in {}\n{}", summary.text(wall_s), options.out_folder.string(),
                   quality::quality_text(report));
        std::fflush(stdout);
    }
    return absl::OkStatus();
}

}  // namespace kinevox
