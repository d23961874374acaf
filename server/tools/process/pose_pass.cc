#include "server/tools/process/pose_pass.h"

#include <algorithm>
#include <utility>

#include "server/pose/pose_stage.h"
#include "server/pose/retrack.h"

namespace kinevox {

PosePass::PosePass(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
                   const PosePassOptions& options)
    : cameras_(std::move(cameras)), fps_(fps), posing_(posing), options_(options) {}
PosePass::~PosePass() = default;

void PosePass::add(const FrameResult& result, PoseStage& stage) {
    Frame frame;
    frame.row.frame = result.sequence;
    frame.row.time_s = 1e-9 * static_cast<double>(result.capture_time_ns);
    frame.row.pose = result.pose;
    if (result.subject) frame.row.subject_id = result.subject->subject_id;
    if (result.pose && stage.tracked()) frame.posture = stage.tracked()->fit.posture;
    if (!retracked_ && result.subject && result.volume)
        frame.observation = std::make_unique<PoseObservation>(stage.observation());
    frames_.push_back(std::move(frame));
    if (!retracked_ && frames_.size() >= options_.max_held_frame_sets) fit_and_retrack(stage);
}

// Of the held frame sets; empty if the fit fails.
std::optional<BodyFit> PosePass::fit_to_movement(const PoseStage& stage) const {
    std::vector<const PoseObservation*> first;
    const auto max_frames = static_cast<std::size_t>(options_.body_seconds * fps_) + 1;
    for (const Frame& frame : frames_)
        if (frame.observation && first.size() < max_frames) first.push_back(frame.observation.get());
    auto fit = fit_body(cameras_, fps_, first, stage.body(), posing_, options_.body);
    return fit.ok() ? std::optional(*std::move(fit)) : std::nullopt;
}

// Fits the body, tracks the held frame sets with it, and sets it in the pipeline for the following ones.
void PosePass::fit_and_retrack(PoseStage& stage) {
    retracked_ = true;
    fit_ = fit_to_movement(stage);
    if (!options_.fit_body)
        body_ = stage.body();
    else if (fit_)
        body_ = fit_->shape;
    if (!body_) return;
    PoseStageOptions posing = posing_;
    const double standing_m = fit_ ? fit_->standing_m : 0;
    posing.tracker.fit.cost.standing_m = standing_m;
    posing.body = *body_;
    std::vector<RecordedView> views;
    for (const Frame& frame : frames_)
        views.push_back({frame.row.subject_id, frame.row.frame, frame.observation.get()});
    std::vector<RetrackedFrame> again = retrack(cameras_, fps_, views, posing);
    for (std::size_t n = 0; n < frames_.size(); ++n) {
        frames_[n].posture = again[n].posture;
        frames_[n].row.pose = std::move(again[n].pose);
        frames_[n].observation.reset();
    }
    stage.set_body(*body_, standing_m);
}

std::vector<PoseRow> PosePass::finish(PoseStage& stage) {
    if (!retracked_) fit_and_retrack(stage);
    std::vector<std::optional<BodyPosture>> postures;
    for (const Frame& frame : frames_) postures.push_back(frame.posture);
    if (options_.cutoff_hz > 0) smooth_zero_phase(postures, fps_, options_.cutoff_hz);
    const BodyModel model(body_.value_or(stage.body()));
    std::vector<PoseRow> rows;
    for (std::size_t n = 0; n < frames_.size(); ++n) {
        PoseRow row = frames_[n].row;
        if (postures[n] && row.pose) {
            auto pose = std::make_shared<BodyPose>(*row.pose);
            describe_posture(model, *postures[n], *pose);
            pose->filtered = options_.cutoff_hz > 0;
            if (n > 0 && rows.back().pose) set_velocities(*rows.back().pose, *pose);
            row.pose = std::move(pose);
        }
        rows.push_back(std::move(row));
    }
    return rows;
}

}  // namespace kinevox
