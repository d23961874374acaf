#include "server/tools/process/pose_pass.h"

#include <algorithm>
#include <functional>
#include <map>
#include <utility>

#include "common/median.h"
#include "server/pipeline/pipeline.h"
#include "server/pose/pose_stage.h"

namespace kinevox {
namespace {

constexpr double kMinOwnBody_s = 2;  // tracked; a body fitted to less is hardly better than another's

}  // namespace

PosePass::PosePass(std::vector<Camera> cameras, double fps, const PipelineOptions& pipeline,
                   const PosePassOptions& options)
    : cameras_(std::move(cameras)),
      fps_(fps),
      posing_(pipeline.posing),
      options_(options),
      lone_(pipeline.tracker.one_person()),
      selected_(pipeline.tracker.rules != SubjectRules{}) {}
PosePass::~PosePass() = default;

PosePass::Subject& PosePass::subject_of(std::uint32_t id) {
    for (const auto& subject : subjects_)
        if (subject->id == id) return *subject;
    Subject& added = *subjects_.emplace_back(std::make_unique<Subject>());
    added.id = id;
    added.first = all_.size() - 1;
    added.frames.resize(1);
    added.frames.front().row = all_.back();
    return added;
}

void PosePass::add(const FrameResult& result, Pipeline& pipeline) {
    all_.push_back({.frame = result.sequence,
                    .time_s = 1e-9 * static_cast<double>(result.capture_time_ns),
                    .subject_id = 0,
                    .pose = nullptr});
    for (const auto& subject : subjects_) subject->frames.emplace_back().row = all_.back();
    for (const SubjectResult& seen : result.subjects) {
        const std::uint32_t id = seen.track.subject_id;
        Subject& subject = subject_of(id);
        Frame& frame = subject.frames.back();
        const PoseStage* const stage = pipeline.pose_stage_of(id);
        ++subject.seen_count;
        frame.row.subject_id = id;
        frame.row.pose = seen.pose;
        if (!stage) continue;
        if (seen.pose && stage->tracked()) frame.posture = stage->tracked()->fit.posture;
        if (!subject.retracked && seen.volume)
            frame.observation = std::make_unique<PoseObservation>(stage->observation());
    }
    for (const auto& subject : subjects_)
        if (!subject->retracked && subject->frames.size() >= options_.max_held_frame_sets)
            fit_and_retrack(*subject, pipeline);
}

// To the held frame sets; empty if the fit fails.
std::optional<BodyFit> PosePass::fit_to_movement(const Subject& subject) const {
    std::vector<const PoseObservation*> first;
    const auto max_frames = static_cast<std::size_t>(options_.body_seconds * fps_) + 1;
    for (const Frame& frame : subject.frames)
        if (frame.observation && first.size() < max_frames) first.push_back(frame.observation.get());
    auto fit = fit_body(cameras_, fps_, first, posing_.body, posing_, options_.body);
    return fit.ok() ? std::optional(*std::move(fit)) : std::nullopt;
}

bool PosePass::is_brief(const Subject& subject) const {
    return static_cast<double>(subject.seen_count) < kMinOwnBody_s * fps_;
}

// Fits the body, tracks the held frame sets with it, and sets it in the pipeline for the following ones.
void PosePass::fit_and_retrack(Subject& subject, Pipeline& pipeline) const {
    subject.retracked = true;
    const Subject* const most = main();
    const bool shares_body = lone_ && &subject != most;
    if (!shares_body || !is_brief(subject)) subject.fit = fit_to_movement(subject);
    if (shares_body && !subject.fit) subject.fit = most->fit;
    if (!options_.fit_body)
        subject.body = posing_.body;
    else if (subject.fit)
        subject.body = subject.fit->shape;
    if (!subject.body) return;
    PoseStageOptions posing = posing_;
    const double standing_m = subject.fit ? subject.fit->standing_m : 0;
    posing.tracker.fit.cost.standing_m = standing_m;
    posing.body = *subject.body;
    std::vector<RecordedView> views;
    for (const Frame& frame : subject.frames)
        views.push_back({frame.row.subject_id, frame.row.frame, frame.observation.get()});
    std::vector<RetrackedFrame> again = retrack(cameras_, fps_, views, posing, options_.searches);
    for (std::size_t n = 0; n < subject.frames.size(); ++n) {
        subject.frames[n].posture = again[n].posture;
        subject.frames[n].row.pose = std::move(again[n].pose);
        subject.frames[n].observation.reset();
    }
    if (PoseStage* const stage = pipeline.pose_stage_of(subject.id))
        stage->set_body({.shape = *subject.body, .standing_m = standing_m});
}

// One for each of its frames.
std::vector<PoseRow> PosePass::rows_of(const Subject& subject) const {
    std::vector<std::optional<BodyPosture>> postures;
    for (const Frame& frame : subject.frames) postures.push_back(frame.posture);
    const double cutoff_hz = applied_cutoff_hz(options_.cutoff_hz, fps_);
    if (cutoff_hz > 0) smooth_zero_phase(postures, fps_, cutoff_hz);
    const BodyModel model(subject.body.value_or(posing_.body));
    std::vector<PoseRow> rows;
    for (std::size_t n = 0; n < subject.frames.size(); ++n) {
        PoseRow row = subject.frames[n].row;
        if (postures[n] && row.pose) {
            auto pose = std::make_shared<BodyPose>(*row.pose);
            describe_posture(model, *postures[n], *pose);
            pose->filtered = cutoff_hz > 0;
            if (n > 0 && rows.back().pose) set_velocities(*rows.back().pose, *pose);
            row.pose = std::move(pose);
        }
        rows.push_back(std::move(row));
    }
    return rows;
}

std::vector<PoseRow> PosePass::finish(Pipeline& pipeline) {
    std::vector<Subject*> by_duration;
    for (const auto& subject : subjects_) by_duration.push_back(subject.get());
    std::ranges::stable_sort(by_duration, std::ranges::greater{}, &Subject::seen_count);
    for (Subject* const subject : by_duration)
        if (!subject->retracked) fit_and_retrack(*subject, pipeline);
    std::vector<std::vector<PoseRow>> each;
    for (const auto& subject : subjects_) each.push_back(rows_of(*subject));
    std::vector<PoseRow> rows;
    for (std::size_t frame = 0; frame < all_.size(); ++frame) {
        const std::size_t before = rows.size();
        for (std::size_t n = 0; n < each.size(); ++n)
            if (const std::size_t first = subjects_[n]->first;
                frame >= first && each[n][frame - first].subject_id != 0)
                rows.push_back(std::move(each[n][frame - first]));
        if (rows.size() == before) rows.push_back(all_[frame]);
    }
    return rows;
}

const PosePass::Subject* PosePass::main() const {
    const auto most =
        std::ranges::max_element(subjects_, {}, [](const auto& subject) { return subject->seen_count; });
    return most == subjects_.end() ? nullptr : most->get();
}

const BodyShape* PosePass::body() const {
    const Subject* const subject = main();
    return subject && subject->body ? &*subject->body : nullptr;
}

std::vector<std::uint32_t> PosePass::followed_subjects() const {
    if (lone_) return {0};
    std::vector<std::uint32_t> ids;
    for (const auto& subject : subjects_)
        if (10 * subject->seen_count >= all_.size()) ids.push_back(subject->id);
    if (ids.empty() && !subjects_.empty()) ids.push_back(main()->id);
    return ids;
}

const PosePass::Subject* PosePass::find(std::uint32_t id) const {
    if (id == 0) return main();
    const auto found = std::ranges::find_if(subjects_, [id](const auto& each) { return each->id == id; });
    return found == subjects_.end() ? nullptr : found->get();
}

const BodyShape* PosePass::body_of(std::uint32_t subject_id) const {
    const Subject* const subject = find(subject_id);
    return subject && subject->body ? &*subject->body : nullptr;
}

const BodyFit* PosePass::fit_of(std::uint32_t subject_id) const {
    const Subject* const subject = find(subject_id);
    return subject && subject->fit ? &*subject->fit : nullptr;
}

PoseFitSummary summarize(std::span<const PoseRow> rows) {
    constexpr double kMany = 0.25;  // of the largest number of poses
    PoseFitSummary out;
    std::map<std::uint32_t, std::vector<double>> residuals_m;  // by subject
    for (const PoseRow& row : rows) {
        if (!row.pose) continue;
        residuals_m[row.subject_id].push_back(row.pose->contour_residual_rms_m);
        out.measured_joints += std::ranges::count_if(row.pose->joints, &JointEstimate::measured);
    }
    if (residuals_m.empty()) return out;
    std::size_t poses = 0, max_poses = 0;
    for (const auto& [subject, each] : residuals_m)
        poses += each.size(), max_poses = std::max(max_poses, each.size());
    double sum_m = 0, max_m = 0;
    for (auto& [subject, each] : residuals_m) {
        const auto count = static_cast<double>(each.size());
        const double median_m = median_of(each);
        sum_m += median_m * count;
        if (count >= kMany * static_cast<double>(max_poses)) max_m = std::max(max_m, median_m);
    }
    out.contour_residual_m = sum_m / static_cast<double>(poses);
    out.max_contour_residual_m = max_m;
    return out;
}

bool is_better(const PoseFitSummary& one, const PoseFitSummary& other) {
    constexpr double kMissing_m = 0.1;  // what a joint without a position counts
    if (!one.contour_residual_m || !other.contour_residual_m) return false;
    const auto all = static_cast<double>(std::max(one.measured_joints, other.measured_joints));
    const auto cost = [&](const PoseFitSummary& run) {
        const double missing = all > 0 ? 1 - static_cast<double>(run.measured_joints) / all : 0;
        return *run.contour_residual_m + kMissing_m * missing;
    };
    return cost(one) < cost(other);
}

}  // namespace kinevox
