#include "server/tools/process/process.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>
#include <vector>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/session_file.h"
#include "common/stopwatch.h"
#include "server/cameras/session_source.h"
#include "server/pose/body_fitter.h"
#include "server/pose/pose_stage.h"
#include "server/quality/faint_switch.h"
#include "server/recording/subject_names.h"
#include "server/tools/process/quality_pass.h"
#include "server/tools/process/run_report.h"

namespace kinevox {
namespace {

absl::Status learn_background(FrameSource& source, Pipeline& pipeline,
                              const std::filesystem::path& session_file) {
    const auto background = background_of_all(source, session_file);
    if (!background.ok()) return background.status();
    return pipeline.learn_background(*background);
}

bool may_run_again(const ProcessOptions& options) {
    return options.pipeline.pose && !options.single_run && !options.pipeline.segmentation.judge_faint;
}

ProcessOptions with_faint(ProcessOptions options) {
    options.pipeline.segmentation.judge_faint = true;
    return options;
}

// One frame set does not determine a body, and a pose found in few of them is doubtful.
constexpr int kMinBodyFrameSets = 5;
// Bodies that fit their silhouettes are 8 to 15 mm from the contours.
constexpr double kMaxBodyResidual_m = 0.025;

// A body fitted to all frame sets of a T-pose session; none if a subject is there, but too few poses.
struct SessionBody {
    std::optional<BodyFit> fit;
    std::string why;  // without a fit, one sentence
};

absl::StatusOr<SessionBody> fit_to_session(const std::filesystem::path& session_file,
                                           const ProcessOptions& options, const std::atomic<bool>& stop) {
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
    auto fit = fit_body((*source)->cameras(), (*source)->fps(), observations, options.pipeline.posing.body,
                        options.pipeline.posing, options.poses.body);
    if (fit.ok() && fit->frame_set_count >= kMinBodyFrameSets) return SessionBody{*std::move(fit), ""};
    std::string why = fmt::format(
        "{}: {}", session_file.string(),
        fit.ok() ? fmt::format("the subject's pose was found in {} of {} frame sets, {} are needed",
                               fit->frame_set_count, observations.size(), kMinBodyFrameSets)
                 : std::string(fit.status().message()));
    if (observations.empty()) return absl::FailedPreconditionError(why);
    return SessionBody{std::nullopt, std::move(why)};
}

// The body of the subject in a T-pose session. None, after a warning, if too few poses were found or the body
// does not fit its silhouettes: then the body is fitted to the trial's movement.
absl::StatusOr<std::optional<BodyShape>> body_of_session(const std::filesystem::path& session_file,
                                                         const ProcessOptions& options,
                                                         const std::atomic<bool>& stop) {
    auto body = fit_to_session(session_file, options, stop);
    if (!body.ok()) return body.status();
    const auto residual_m = [](const SessionBody& one) {
        return one.fit ? one.fit->contour_residual_rms_m : std::numeric_limits<double>::infinity();
    };
    if (may_run_again(options) && residual_m(*body) > quality::kMaxContourResidual_m) {
        auto again = fit_to_session(session_file, with_faint(options), stop);
        if (!again.ok()) return again.status();
        if (residual_m(*again) < quality::kMaxContourResidual_m) body = std::move(again);
    }
    if (residual_m(*body) <= kMaxBodyResidual_m) return body->fit->shape;
    if (body->fit)
        body->why = fmt::format(
            "{}: the fitted body is {:.0f} mm from the silhouettes' contours (at most {:.0f}); record a "
            "background for this session",
            session_file.string(), 1000 * residual_m(*body), 1000 * kMaxBodyResidual_m);
    fmt::print(stderr, "kinevox process: {}; the body is fitted to the movement instead\n", body->why);
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

// Those that a recording's subjects had while it was made. A damaged file of names spoils no results.
RecordedNames names_of_session(const std::filesystem::path& session_file) {
    auto names = RecordedNames::of_session(session_file);
    if (names.ok()) return *std::move(names);
    fmt::print(stderr, "kinevox process: {}; the subjects have no names\n",
               std::string(names.status().message()));
    return {};
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

// What a run through the whole session finds, besides what the writer holds.
struct Run {
    double fps = 0, wall_s = 0;
    RunSummary summary;
    PoseFitSummary poses;
    quality::QualityReport quality;
};

class SessionRuns {
  public:
    SessionRuns(const std::string& fingerprint, const std::atomic<bool>& stop)
        : fingerprint_(fingerprint), stop_(stop) {}

    // Processes the session and adds the results to the writer, as its latest version.
    absl::StatusOr<Run> run(const ProcessOptions& options);
    ResultWriter& writer() { return *writer_; }

  private:
    // What takes each result besides the writer.
    struct Takers {
        PosePass* poses;  // null: none
        QualityPass& quality;
        RecordedNames& names;
        RunSummary& summary;
    };
    absl::Status each_frame_set(const ProcessOptions& options, FrameSource& source, Pipeline& pipeline,
                                const Takers& takers);

    const std::string& fingerprint_;
    const std::atomic<bool>& stop_;
    std::unique_ptr<ResultWriter> writer_;
};

absl::Status SessionRuns::each_frame_set(const ProcessOptions& options, FrameSource& source,
                                         Pipeline& pipeline, const Takers& takers) {
    RunSummary& summary = takers.summary;
    std::int64_t total = source.frame_count();
    if (total > 0) total = (total + options.every - 1) / options.every;
    if (options.max_frames > 0 && (total < 0 || total > options.max_frames)) total = options.max_frames;
    ProgressBar bar(total, options.quiet);
    for (std::int64_t n = 0; options.max_frames == 0 || summary.frames() < options.max_frames; ++n) {
        if (stop_)
            return absl::CancelledError(
                fmt::format("stopped after {} frame sets; nothing was written", summary.frames()));
        const Stopwatch decoding;
        auto frame_set = source.next();
        if (absl::IsOutOfRange(frame_set.status())) break;
        if (!frame_set.ok()) return frame_set.status();
        if (n % options.every != 0) continue;
        frame_set->decode_ms = decoding.ms();
        auto result = pipeline.process(std::move(*frame_set));
        if (!result.ok()) return result.status();
        summary.add(**result);
        if (takers.poses) takers.poses->add(**result, pipeline);
        takers.quality.add(**result);
        for (const SubjectResult& subject : (*result)->subjects)
            takers.names.add(static_cast<std::int64_t>((*result)->sequence), subject.track.subject_id,
                             subject.track.centre_in_world);
        if (absl::Status added = writer_->add(std::move(*result)); !added.ok()) return added;
        bar.show(summary.frames());
    }
    return absl::OkStatus();
}

absl::StatusOr<Run> SessionRuns::run(const ProcessOptions& options) {
    SessionSourceOptions source_options;
    source_options.decode_in_bursts = options.decode_in_bursts;
    auto source = open_session_source(options.session_file, source_options);
    if (!source.ok()) return source.status();
    Run run;
    run.fps = (*source)->fps() / options.every;
    auto pipeline = Pipeline::create((*source)->cameras(), run.fps, options.pipeline);
    if (!pipeline.ok()) return pipeline.status();
    if (writer_) {
        if (absl::Status begun = writer_->begin_version(); !begun.ok()) return begun;
    } else {
        std::vector<std::string> names;
        for (const Camera& camera : (*source)->cameras()) names.push_back(camera.name);
        auto writer = ResultWriter::create(options.out_folder, names, options.writer);
        if (!writer.ok()) return writer.status();
        writer_ = *std::move(writer);
    }
    const auto background = background_of_all(**source, options.session_file);
    if (!background.ok()) return background.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;

    std::optional<PosePass> poses;
    if ((*pipeline)->pose_stage())
        poses.emplace((*source)->cameras(), run.fps, options.pipeline, options.poses);
    QualityPass quality(options.session_file, (*source)->cameras(), *background,
                        options.pipeline.segmentation.judge_faint);
    RecordedNames recorded_names = names_of_session(options.session_file);
    const Stopwatch running;
    if (absl::Status done = each_frame_set(options, **source, **pipeline,
                                           {poses ? &*poses : nullptr, quality, recorded_names, run.summary});
        !done.ok())
        return done;
    run.wall_s = running.seconds();
    writer_->add_table({"calibration.toml", calibration_toml((*source)->cameras())});
    for (Table& table : certificate_tables(options.session_file)) writer_->add_table(std::move(table));
    const std::vector<PoseRow> rows = poses ? poses->finish(**pipeline) : std::vector<PoseRow>{};
    const SubjectNames names = recorded_names.names();
    if (poses)
        for (Table& table : tables_of(rows, *poses)) writer_->add_table(std::move(table));
    if (poses && !names.empty())
        writer_->add_table({std::string(kSubjectNamesFile), subject_names_csv(names)});
    run.poses = summarize(rows);
    run.quality = quality.finish(poses ? &*poses : nullptr, rows, names);
    writer_->add_table({"quality.json", quality::quality_json(run.quality)});
    writer_->add_table(
        {"run.toml", run_toml(options, fingerprint_, run.fps, run.summary.frames())});  // the last
    return run;
}

// Whether the silhouettes may lack parts of a subject: the posed bodies do not fit them, and nothing else
// explains that.
bool may_lack_parts(const Run& run) {
    return run.poses.max_contour_residual_m.value_or(0) > quality::kMaxContourResidual_m &&
           quality::may_lack_parts(run.quality.causes);
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
        if (*body) options.pipeline.posing.set_body(**body);
    }
    SessionRuns runs(*fingerprint, stop);
    auto run = runs.run(options);
    if (!run.ok()) return run.status();
    int version = 0;
    if (may_run_again(options) && may_lack_parts(*run)) {
        if (!options.quiet)
            fmt::print(
                "silhouettes may lack parts of the subject; processing the session again with "
                "segmentation.judge_faint\n");
        auto again = runs.run(with_faint(options));
        if (!again.ok()) return again.status();
        if (is_better(again->poses, run->poses)) {
            run = std::move(again);
            version = 1;
        }
    }
    if (absl::Status finished = runs.writer().finish(version); !finished.ok()) return finished;
    if (!options.quiet) {
        fmt::print("{}results in {}\n{}", run->summary.text(run->wall_s), options.out_folder.string(),
                   quality::quality_text(run->quality));
        std::fflush(stdout);
    }
    return absl::OkStatus();
}

}  // namespace kinevox
