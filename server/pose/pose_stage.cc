#include "server/pose/pose_stage.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <cmath>

namespace kinevox {
namespace {

// Cost per unit of log probability of a posture, judged by one frame set: its rays are not independent.
constexpr double kFrameSetTemperature = 12;

// Live, no later frame set corrects a lost limb. By live.py over random trials of sweep.py: halves the silent
// errors, withholds 3 % of the joints more.
constexpr double kLiveGrossLogOdds = 1.5;
// A pose that was just found, in few frame sets and without the subject's colours: these odds fall with time.
constexpr double kNewLogOdds = 2.5, kNew_s = 0.4;

constexpr std::int64_t kLearnInterval_ns = 200'000'000;
constexpr double kMinLearnedExplained = 0.85;  // see PoseFit::explained

}  // namespace

std::string BodyFitOptions::check() const {
    if (max_frames < 1 || size_frames < 1 || rounds < 1 || steps < 1)
        return "body fit: frames, rounds and steps must be at least 1";
    if (!(independent_frames > 0) || !(stature_std_m > 0))
        return "body fit: independent_frames and stature_std_m must be positive";
    return {};
}

std::string PoseStageOptions::check() const {
    for (std::string problem : {tracker.check(), filter.check()})
        if (!problem.empty()) return problem;
    if (candidates < 0) return "pose stage: candidates is negative; 0 or more is allowed";
    return {};
}

PoseStage::PoseStage(std::vector<Camera> cameras, double fps, const PoseStageOptions& options)
    : cameras_(std::move(cameras)),
      options_(options),
      tracker_(fps, options.tracker),
      judge_(options.tracker.fit.cost),
      filter_(options.filter) {
    if (options_.filtered) options_.estimate.gross_log_odds = kLiveGrossLogOdds;
    set_body(options.initial_body());
}

void PoseStage::set_body(const BodyInUse& body) {
    tracker_.set_model(std::make_shared<BodyModel>(body.shape));
    tracker_.set_standing(body.standing_m);
    judge_.set_standing(body.standing_m);
    options_.estimate.body_std_m = body.std_m;
}

void PoseStage::reset() {
    tracker_.reset();
    filter_.reset();
    tracked_.reset();
    last_.reset();
    missing_legs_ = {};
    colours_.clear();
}

// Of frame sets whose silhouettes the posture explains.
void PoseStage::learn_colours(std::int64_t time_ns, std::span<const SilhouetteRays> views,
                              std::span<const BodyCapsule> capsules) {
    if (!options_.filtered || std::abs(time_ns - learned_ns_) < kLearnInterval_ns ||
        tracked_->fit.explained < kMinLearnedExplained)
        return;
    learned_ns_ = time_ns;
    colours_.add(views, capsules);
}

// Usually the coarse projection suffices; the fine one is computed only if a silhouette must be masked.
void PoseStage::mask_views(const kernels::VoxelVolume& volume, const MainBody& body,
                           std::vector<PoseView>& views) {
    constexpr int kWide = 80,
                  kNarrow = 300;  // the projections are dilated by these fractions of the image height
    masked_.resize(cameras_.size());
    mask_.resize(cameras_.size());
    std::vector<char> cluttered(views.size(), 0);
    const auto each = [&](const auto& body_of) {
        oneapi::tbb::parallel_for(std::size_t{0}, views.size(), body_of, oneapi::tbb::simple_partitioner());
    };
    each([&](std::size_t c) {
        if (!views[c].silhouettes) return;
        const int dilate_px = std::max(1, views[c].silhouettes->height / kWide);
        cluttered[c] = fraction_outside(*views[c].silhouettes, body.volume, *views[c].camera, dilate_px,
                                        mask_[c]) > options_.max_outside_fraction;
    });
    if (std::none_of(cluttered.begin(), cluttered.end(), [](char c) { return c != 0; })) return;
    const kernels::VoxelVolume fine = inside_of(volume, body.volume, kCoarseFactor);
    each([&](std::size_t c) {
        if (!cluttered[c]) return;
        const int dilate_px = std::max(1, views[c].silhouettes->height / kNarrow);
        fraction_outside(*views[c].silhouettes, fine, *views[c].camera, dilate_px, mask_[c]);
        apply_mask(*views[c].silhouettes, mask_[c], views[c].silhouettes->bounds, masked_[c]);
        views[c].silhouettes = &masked_[c];
    });
}

std::shared_ptr<BodyPose> PoseStage::process(std::uint32_t subject_id, std::uint64_t sequence,
                                             std::int64_t time_ns, std::span<const PoseView> views,
                                             const kernels::VoxelVolume& volume,
                                             const kernels::VoxelVolume& coarse, Vec3 centre) {
    std::vector<PoseView> shown(views.begin(), views.end());
    if (const std::optional<MainBody> body = main_body(coarse)) {
        centre = body->centre_in_world;
        mask_views(volume, *body, shown);
    }
    observation_.time_ns = time_ns;
    observation_.centre_in_world = centre;
    observation_.views.resize(cameras_.size());
    const bool by_contrast = !options_.filtered;  // live, the fit needs all of the contour
    oneapi::tbb::parallel_for(
        std::size_t{0}, cameras_.size(),
        [&](std::size_t c) {
            observation_.views[c].camera = nullptr;
            if (c >= shown.size() || !shown[c].silhouettes) return;
            read_silhouette(cameras_[c], *shown[c].silhouettes, options_.tracker.rays, observation_.views[c],
                            by_contrast ? shown[c].image : kernels::ImageView{}, shown[c].shared);
            read_colours(shown[c].image, *shown[c].silhouettes, options_.tracker.rays.colour_side,
                         observation_.views[c].colours);
        },
        oneapi::tbb::simple_partitioner());
    std::vector<PoseCandidate> candidates;
    if (proposer_ && !tracker_.tracking())
        candidates = proposer_->propose(shown, centre, options_.candidates);
    return process(subject_id, sequence, time_ns, observation_, candidates);
}

// Of the postures that the tracker considered, by their costs in this frame set alone.
std::vector<WeightedPosture> PoseStage::alternatives(std::span<const SilhouetteRays> views) {
    std::vector<WeightedPosture> weighted;
    double sum = 1;
    for (const BodyPosture& posture : tracked_->alternatives) {
        Linearisation at;
        judge_.linearise(tracker_.model(), posture, views, nullptr, options_.tracker.fit.narrow_m, at);
        const double weight = std::exp(std::min(0.0, data_cost_ - at.cost) / kFrameSetTemperature);
        weighted.push_back({posture, weight});
        sum += weight;
    }
    for (const JudgedPosture& near : tracked_->around) {
        weighted.push_back({near.posture, std::exp(std::min(0.0, -near.cost_above) / kFrameSetTemperature)});
        sum += weighted.back().probability;
    }
    for (WeightedPosture& w : weighted) w.probability /= sum;
    return weighted;
}

std::shared_ptr<BodyPose> PoseStage::process(std::uint32_t subject_id, std::uint64_t sequence,
                                             std::int64_t time_ns, const PoseObservation& seen,
                                             std::span<const PoseCandidate> candidates) {
    tracked_ = tracker_.update(time_ns, seen.views, seen.centre_in_world, candidates,
                               colours_.empty() ? nullptr : &colours_);
    if (!tracked_) {
        missing_legs_ = {};
        filter_.reset();
        last_.reset();
        return nullptr;
    }
    auto pose = std::make_shared<BodyPose>();
    pose->subject_id = subject_id;
    pose->sequence = sequence;
    pose->capture_time_ns = time_ns;
    pose->contour_residual_rms_m = tracked_->fit.contour_residual_rms_m;
    pose->filtered = options_.filtered;
    Linearisation data;
    judge_.linearise(tracker_.model(), tracked_->fit.posture, seen.views, nullptr,
                     options_.tracker.fit.narrow_m, data);
    data_cost_ = data.cost;
    const std::vector<SurfaceTerm> terms = judge_.terms();
    const std::vector<BodyCapsule> capsules = judge_.capsules();
    EstimateOptions estimate = options_.estimate;
    if (options_.filtered) estimate.gross_log_odds += kNewLogOdds * std::exp(-tracked_->seconds / kNew_s);
    judge_posture(tracker_.model(), tracked_->fit.posture, data, seen.views, terms, capsules,
                  alternatives(seen.views), static_cast<int>(cameras_.size()), estimate, *pose);
    learn_colours(time_ns, seen.views, capsules);
    const LegSight legs = see_legs(tracker_.model(), tracked_->fit.posture, seen.views);
    withhold_legs(missing_legs_.update(time_ns, legs), *pose);
    const BodyPosture& measured = tracked_->fit.posture;
    describe_posture(tracker_.model(), options_.filtered ? filter_.filter(measured, time_ns) : measured,
                     *pose);
    if (last_) set_velocities(*last_, *pose);
    last_ = pose;
    return pose;
}

}  // namespace kinevox
