#include "server/pose/pose_tracker.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>
#include <utility>

#include "server/pose/arm_search.h"
#include "server/pose/foot_turn.h"
#include "server/pose/key_poses.h"
#include "server/pose/turned_posture.h"

namespace kinevox {
namespace {

// Weights of what was before after a reference interval; see reference_intervals().
constexpr double kMinReferenceInterval_s = 1.0 / 31, kMaxReferenceInterval_s = 1.0 / 24;
constexpr double kRateMemory = 0.6, kCostMemory = 0.85, kUsualMemory = 0.997;
constexpr double kPredictionDamping = 0.9;
constexpr double kPoorer = 0.03;
// Rays of a camera far from the body, beyond their usual number, that suggest a lost limb. The usual one
// rises by this per reference interval, and by this fraction where a search finds nothing.
constexpr int kProtruding = 4;
constexpr double kProtrudingRise = 0.07, kProtrudingRiseInVain = 0.5;
constexpr int kMaxLimbRounds = 3;
constexpr double kUnusualGap = 2.5, kIntervalMemory = 0.9;  // of the usual interval
constexpr double kBetter = 2,
                 kClearlyBetter =
                     12;  // minimum decrease of the cost by a limb search; 2 is about two contour rays
// Arms and legs in either order, then an arm that may have taken the place of a raised leg.
constexpr std::array<std::pair<Limb, Limb>, 8> kAllPairs{{{Limb::kArmL, Limb::kArmR},
                                                          {Limb::kLegL, Limb::kLegR},
                                                          {Limb::kArmR, Limb::kArmL},
                                                          {Limb::kLegR, Limb::kLegL},
                                                          {Limb::kLegL, Limb::kArmL},
                                                          {Limb::kLegR, Limb::kArmR},
                                                          {Limb::kLegL, Limb::kArmR},
                                                          {Limb::kLegR, Limb::kArmL}}};
// In the first second of tracking these are searched again at the intervals below regardless of the explained
// fraction: coinciding limbs leave little unexplained.
constexpr auto kLimbPairs = std::span(kAllPairs).first<4>();
constexpr double kPairIntervals = 7, kFrequentPairIntervals = 3;  // reference intervals
constexpr double kPairSeconds = 1;
// The body that faces the other way is fitted, too, at these intervals. Its decrease of the cost is summed,
// and the sum decays by this factor per interval; beyond the limit it replaces the tracked one.
constexpr double kTurnInterval_s = 0.15, kTurnMemory = 0.85, kTurnEvidence = 60;
// A mirrored elbow is fitted unless it costs more by this before the fit.
constexpr double kMirroredSlack = 10;
// Live, a fit from another start that costs less than this more is another reading of the silhouettes.
constexpr double kConceivable = 36;
// Live, a pose is searched from the beginning if the searches of limbs leave so much less explained than
// usual, and this number of a camera's rays unexplained; or if they explain less than good poses, which are
// at .9 to 1 (bodies upside down: .6 to .75).
constexpr double kDoubtfulFraction = 0.08;
constexpr int kDoubtfulRays = 15;
constexpr double kPoorlyExplained = 0.8;
constexpr double kDoubtInterval_s = 0.3;  // after a search in vain
constexpr double kSame_m = 0.06;          // hypotheses with a smaller mean joint distance are merged

constexpr std::array<Limb, 2> kLimbsOfArms{Limb::kArmL, Limb::kArmR};
constexpr double kArmBetterAmongOthers = 36;  // of move_arms(), as are the next lines
constexpr double kDoubtfulMove_rad = 0.6;
constexpr std::array<double, 3> kArmMoves_rad{0.3, 0.15, 0.6}, kFallingArmMoves_rad{0.6, 0.3, 0.15};
constexpr std::size_t kArmStarts = 3;       // of a search anywhere
constexpr std::size_t kFirstArmStarts = 6;  // of that of a pose that was just found
constexpr std::size_t kStartCount = 3, kWorkspaces = kStartCount + 1;  // of try_other_starts()

// A weight per reference interval as the weight over `seconds`.
double kept(double per_reference_interval, double seconds) {
    return std::pow(per_reference_interval, reference_intervals(seconds));
}

// Below this fraction of the stature a body's centre is lower than that of a standing, stepping or squatting
// one: it lies, sits or is on all fours.
constexpr double kLowCentre = 0.36;

double mean_joint_distance(const PosedBody& a, const PosedBody& b) {
    double sum = 0;
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        sum += norm(a.joints_in_world[j] - b.joints_in_world[j]);
    return sum / kJointNames.size();
}

}  // namespace

double reference_intervals(double seconds) {
    if (seconds < kMinReferenceInterval_s) return seconds / kMinReferenceInterval_s;
    return std::max(1.0, seconds / kMaxReferenceInterval_s);
}

std::string PoseTrackerOptions::check() const {
    if (std::string problem = fit.check(); !problem.empty()) return problem;
    if (headings < 1 || starts < 1 || hypotheses < 1)
        return fmt::format("pose tracker: {} headings, {} starts, {} hypotheses; each must be at least 1",
                           headings, starts, hypotheses);
    if (min_views < 2) return fmt::format("pose tracker: min_views is {}; at least 2", min_views);
    return {};
}

PoseTracker::PoseTracker(double fps, const PoseTrackerOptions& options)
    : fps_(fps), options_(options), model_(std::make_shared<BodyModel>(default_body_shape())) {
    workspaces_.reserve(kWorkspaces);
    for (std::size_t k = 0; k < kWorkspaces; ++k) workspaces_.emplace_back(options.fit);
}

void PoseTracker::set_standing(double standing_m) {
    for (Workspace& work : workspaces_) work.set_standing(standing_m);
}

// `body` of 0 to count - 1, each with a workspace that no other uses meanwhile.
template <typename F>
void PoseTracker::in_parallel(std::size_t count, const F& body) {
    oneapi::tbb::parallel_for(
        std::size_t{0}, std::min(count, workspaces_.size()),
        [&](std::size_t w) {
            for (std::size_t n = w; n < count; n += workspaces_.size()) body(workspaces_[w], n);
        },
        oneapi::tbb::simple_partitioner());
}

// Fits from those of the candidates and the key poses, at that centre and in all directions, that cost least.
std::vector<PoseTracker::Hypothesis> PoseTracker::found_at(Vec3 centre, std::span<const SilhouetteRays> views,
                                                           std::span<const PoseCandidate> candidates) {
    std::vector<BodyPosture> postures;
    const auto add = [&](const BodyCoordinates& q) {
        postures.push_back(posture_from_coordinates(centred(*model_, q, centre)));
    };
    for (const PoseCandidate& candidate : candidates) add(candidate.coordinates);
    std::vector<BodyCoordinates> poses = key_poses();
    if (centre.z < kLowCentre * model_->shape().stature_m)
        for (const BodyCoordinates& pose : floor_poses()) poses.push_back(pose);
    for (const BodyCoordinates& pose : poses)
        for (int h = 0; h < options_.headings; ++h)
            add(with_heading(pose, 2 * std::numbers::pi * h / options_.headings));
    std::vector<double> costs(postures.size());
    in_parallel(costs.size(), [&](Workspace& work, std::size_t n) {
        costs[n] = work.fitter.cost_of(*model_, views, postures[n]);
    });
    std::vector<std::size_t> order(costs.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t a, std::size_t b) { return costs[a] < costs[b]; });
    order.resize(std::min(order.size(), static_cast<std::size_t>(options_.starts)));
    std::vector<Hypothesis> found(order.size());
    in_parallel(order.size(), [&](Workspace& work, std::size_t n) {
        Hypothesis& h = found[n];
        h.fit = work.fitter.fit(*model_, views, postures[order[n]], nullptr, true);
        h.fit = work.fitter.fit(*model_, views, h.fit.posture, nullptr, true);
        h.posture = h.fit.posture;
        h.cost = h.fit.at.cost;
    });
    return found;
}

void PoseTracker::begin(std::span<const SilhouetteRays> views, Vec3 centre,
                        std::span<const PoseCandidate> candidates) {
    hypotheses_ = found_at(centre, views, candidates);
    choose();
    if (!options_.search_at_start) return;
    in_parallel(hypotheses_.size(), [&](Workspace& work, std::size_t n) {
        Hypothesis& h = hypotheses_[n];
        for (int round = 0; round < 2; ++round)
            for (const Limb limb : kLimbs) search_limb(work, h, views, limb, LimbSearchScope::kWhole);
        for (const auto& [first, second] : kLimbPairs) search_pair(work, h, views, first, second);
        // No key pose may have this arm or this leg in front.
        for (const LimbSegmentPairs& limbs : {kArmSegments, kLegSegments})
            try_moved(work, h, views, exchanged(h.posture, limbs), kBetter);
        for (const Limb arm : kLimbsOfArms) try_arm_elsewhere(work, h, views, arm);
        h.cost = h.fit.at.cost;
    });
    choose();
}

// Searches a limb globally and keeps the result only if the whole body fits better with it.
void PoseTracker::search_limb(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views,
                              Limb limb, LimbSearchScope scope) {
    const auto end = static_cast<std::size_t>(kSegmentFarJoint[segments_of(limb).lower]);
    // Among other people small gains are no evidence: a limb may fit anywhere in their silhouettes.
    const bool hidden = is_among_others(views, model_->forward(h.posture).joints_in_world[end]);
    try_moved(work, h, views,
              work.limbs.improve(*model_, h.posture, views, limb, scope, 2 * options_.fit.narrow_m),
              hidden ? kClearlyBetter : kBetter);
    if (limb == Limb::kArmL || limb == Limb::kArmR) try_mirrored_elbow(work, h, views, limb);
}

// A bent arm whose elbow is on the wrong side explains its silhouettes nearly as well. A shoulder hardly
// turns so far; away from a possible twist takes a clear gain.
void PoseTracker::try_mirrored_elbow(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views,
                                     Limb arm) {
    const int upper_arm = arm == Limb::kArmL ? kUpperArmL : kUpperArmR;
    const BodyPosture mirrored = elbow_mirrored(*model_, h.posture, upper_arm);
    const double cost = work.fitter.cost_of(*model_, views, mirrored);
    if (cost > work.fitter.cost_of(*model_, views, h.posture) + kMirroredSlack) return;
    const bool better_twist =
        std::abs(upper_arm_twist(mirrored, upper_arm)) < std::abs(upper_arm_twist(h.posture, upper_arm));
    try_moved(work, h, views, mirrored, better_twist ? kBetter : kClearlyBetter);
}

// A search proposes the cheapest of coarse configurations: where an arm may hide before the trunk, none that
// hangs beside it.
void PoseTracker::try_arm_elsewhere(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views,
                                    Limb arm) {
    const std::vector<BodyPosture> starts =
        work.limbs.plausible(*model_, h.posture, views, arm, 2 * options_.fit.narrow_m);
    for (const BodyPosture& start : std::span(starts).first(std::min(starts.size(), kFirstArmStarts)))
        try_moved(work, h, views, start, kBetter);
}

void PoseTracker::search_pair(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views,
                              Limb first, Limb second) {
    // A tracked body changes only for a clear gain.
    const double gain = h.seconds == 0 ? kBetter : kClearlyBetter;
    try_moved(work, h, views,
              work.limbs.improve_pair(*model_, h.posture, views, first, second, 2 * options_.fit.narrow_m),
              gain);
}

// The directions of a whole limb are coarse: where one was found, its lower half may be wrong still.
void PoseTracker::search_all(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views) {
    for (const Limb limb : kLimbs) {
        search_limb(work, h, views, limb, LimbSearchScope::kWhole);
        search_limb(work, h, views, limb, LimbSearchScope::kLower);
    }
    for (const auto& [first, second] : kAllPairs) search_pair(work, h, views, first, second);
}

// The limb whose search lowers the cost the most, and further ones; pairs where no limb is found.
bool PoseTracker::search_protruding(Hypothesis& h, std::span<const SilhouetteRays> views) {
    const double robust_m = 2 * options_.fit.narrow_m;
    const auto search_one = [&](Workspace& work, std::size_t k) {
        const auto scope = k < kLimbs.size() ? LimbSearchScope::kWhole : LimbSearchScope::kLower;
        return work.limbs.improve(*model_, h.posture, views, kLimbs[k % kLimbs.size()], scope, robust_m);
    };
    const auto search_two = [&](Workspace& work, std::size_t k) {
        const auto& [first, second] = kAllPairs[k];
        return work.limbs.improve_pair(*model_, h.posture, views, first, second, robust_m);
    };
    const double gain = shows_others(views) ? kClearlyBetter : kBetter;  // whose silhouettes explain any limb
    int found = 0;
    while (found < kMaxLimbRounds && try_searches(h, views, 2 * kLimbs.size(), gain, search_one)) ++found;
    for (const Limb arm : {Limb::kArmL, Limb::kArmR}) try_mirrored_elbow(workspaces_.front(), h, views, arm);
    return found > 0 || try_searches(h, views, kAllPairs.size(), kClearlyBetter, search_two);
}

// Runs `search` of 0 to count - 1 in parallel and replaces the posture by the best fit of what they find if
// it costs less by `gain`.
template <typename Search>
bool PoseTracker::try_searches(Hypothesis& h, std::span<const SilhouetteRays> views, std::size_t count,
                               double gain, const Search& search) {
    std::vector<std::optional<PoseFit>> found(count);
    double stayed = 0;
    in_parallel(count + 1, [&](Workspace& work, std::size_t k) {
        if (k == count) {
            stayed = free_fit(work, h, views, h.posture).total();
        } else if (const std::optional<BodyPosture> moved = search(work, k)) {
            found[k] = work.fitter.fit(*model_, views, *moved, nullptr, true);
        }
    });
    std::optional<PoseFit>* best = nullptr;
    double cheapest = stayed - gain;
    for (std::optional<PoseFit>& fit : found)
        if (const double cost = fit ? fit->at.cost + colour_cost(views, fit->posture) : cheapest;
            cost < cheapest)
            best = &fit, cheapest = cost;
    if (!best) return false;
    replace(h, std::move(**best));
    return true;
}

const PoseTracker::FreeFit& PoseTracker::free_fit(Workspace& work, Hypothesis& h,
                                                  std::span<const SilhouetteRays> views,
                                                  const BodyPosture& start) {
    if (!h.free || h.free->start != start) {
        const PoseFit fit = work.fitter.fit(*model_, views, start, nullptr, false);
        h.free = {start, fit.at.cost, colour_cost(views, fit.posture)};
    }
    return *h.free;
}

void PoseTracker::try_moved(Workspace& work, Hypothesis& h, std::span<const SilhouetteRays> views,
                            const std::optional<BodyPosture>& moved, double gain) {
    if (!moved) return;
    PoseFit fit = work.fitter.fit(*model_, views, *moved, nullptr, true);
    if (fit.at.cost + colour_cost(views, fit.posture) + gain < free_fit(work, h, views, h.posture).total())
        replace(h, std::move(fit));
}

// Its motion so far was that of another posture.
void PoseTracker::replace(Hypothesis& h, PoseFit fit) {
    h.replaced.push_back(h.posture);
    for (auto& of_arm : h.around) of_arm.clear();
    h.fit = std::move(fit);
    h.posture = h.fit.posture;
    h.rate = {};
}

// Also after a gap. Where frame sets are lost all the time the processor is too slow, and searches would lose
// more.
bool PoseTracker::searches_fully(double seconds) const {
    return 1 / fps_ >= options_.full_search_interval_s ||
           (seconds >= options_.full_search_interval_s && seconds > kUnusualGap * usual_interval_s_);
}

void PoseTracker::follow(Hypothesis& h, std::span<const SilhouetteRays> views, double seconds) {
    BodyStep ahead;
    const double damping = kept(kPredictionDamping, seconds);
    for (int k = 0; k < kBodyDofCount; ++k) ahead[k] = damping * seconds * h.rate[k];
    // The first rate is still unknown and may be large.
    const double first = h.seconds == 0 ? 4 : 1;
    const MotionPrior prior = motion_prior(stepped(h.posture, ahead), seconds * seconds * first, options_);
    h.replaced.clear();
    h.free.reset();
    h.fit = workspaces_.front().fitter.fit(*model_, views, prior.expected, &prior,
                                           searches_fully(seconds) || !shows_others(views));
    BodyPosture carried = h.posture;
    carried.root_in_world = prior.expected.root_in_world;
    if (try_other_starts(h, views, carried)) {
        h.rate = {};  // its motion so far was that of another posture
    } else {
        const BodyStep moved = step_between(h.posture, h.fit.posture);
        const double keep = h.seconds == 0 ? 0 : kept(kRateMemory, seconds);
        for (int k = 0; k < kBodyDofCount; ++k)
            h.rate[k] = keep * h.rate[k] + (1 - keep) * moved[k] / seconds;
    }
    h.posture = h.fit.posture;
    const double kept_cost = kept(kCostMemory, seconds);
    h.cost = kept_cost * h.cost + (1 - kept_cost) * h.fit.at.cost;
    h.seconds += seconds;
}

// Fits without the prior from the posture before, carried along, since a limb that reversed its motion is far
// from where its rate leads, and with left and right limbs exchanged, which passed each other. True: these
// replaced the fit.
bool PoseTracker::try_other_starts(Hypothesis& h, std::span<const SilhouetteRays> views,
                                   const BodyPosture& carried) {
    const bool beside_others = shows_others(views);  // whose silhouettes explain a limb anywhere
    const std::array<BodyPosture, kStartCount> starts{carried, exchanged(h.fit.posture, kArmSegments),
                                                      exchanged(h.fit.posture, kLegSegments)};
    const JointPositions known = model_->forward(h.fit.posture).joints_in_world;
    std::array<std::optional<PoseFit>, kStartCount> found;
    // Live, nothing later corrects a start that was given up: in one of eight captures legs stayed exchanged.
    std::optional<double> known_cost;
    if (!is_live()) known_cost = workspaces_.front().fitter.cost_of(*model_, views, h.fit.posture);
    double cost = 0;
    in_parallel(kStartCount + 1, [&](Workspace& work, std::size_t k) {
        PoseFitter& fitter = work.fitter;
        if (k == kStartCount) {
            cost = free_fit(work, h, views, h.fit.posture).total();
            return;
        }
        if (beside_others && k > 0) return;
        if (known_cost && k > 0 &&
            fitter.cost_of(*model_, views, starts[k]) > max_exchanged_cost(*known_cost))
            return;
        const PoseFit near = fitter.approach(*model_, views, starts[k], nullptr);
        if (known_cost && near.at.cost > max_approached_cost(*known_cost)) return;
        if (max_joint_distance(model_->forward(near.posture).joints_in_world, known) >= kKnownJoints_m)
            found[k] = fitter.fit(*model_, views, near.posture, nullptr, false);
    });
    bool is_exchanged = false;
    for (std::size_t k = 0; k < kStartCount; ++k) {
        const double gain = k == 0 && !beside_others ? kBetter : kClearlyBetter;
        if (!found[k]) continue;
        const double other = found[k]->at.cost + colour_cost(views, found[k]->posture);
        if (other + gain >= cost) {
            if (is_live() && k > 0 && other < cost + kConceivable) h.replaced.push_back(found[k]->posture);
            continue;
        }
        cost = other;
        h.replaced.push_back(h.fit.posture);
        h.fit = *std::move(found[k]);
        is_exchanged = k > 0;
    }
    return is_exchanged;
}

// Colours show where an arm before the trunk is, silhouettes hardly. Both arms are moved, and one is searched
// anywhere. In a recording retrack() does so, and a pass moves one arm by one angle, unless others are seen.
void PoseTracker::move_arms(Hypothesis& h, std::span<const SilhouetteRays> views) {
    const std::size_t arm = next_move_ % kLimbsOfArms.size();
    const std::size_t angle = next_move_ / kLimbsOfArms.size() % kArmMoves_rad.size();
    ++next_move_;
    if (is_live())
        for (const bool anywhere : {true, false})
            move_arm(h, views, anywhere ? arm : (arm + 1) % kLimbsOfArms.size(), kFallingArmMoves_rad, 2,
                     anywhere ? kArmStarts : 0);
    else
        move_arm(h, views, arm, std::span(kArmMoves_rad).subspan(angle, 1), 1, 0);
}

// What an arm that is elsewhere costs is part of the result's uncertainty.
void PoseTracker::move_arm(Hypothesis& h, std::span<const SilhouetteRays> views, std::size_t arm,
                           std::span<const double> angles, int max_moves, std::size_t starts) {
    ArmSearch search(*model_, h.posture, kLimbsOfArms[arm], views, *colours_, options_.fit);
    search.improve(angles, max_moves);
    if (starts > 0) search.improve_anywhere(workspaces_.front().limbs, angles, max_moves, starts);
    const double gain = shows_others(views) ? kArmBetterAmongOthers : is_live() ? kClearlyBetter : kBetter;
    if (search.gain() >= gain) {
        const BodyPosture before = std::exchange(h.posture, search.best().posture);
        h.fit.posture = h.posture;
        if (max_joint_distance(model_->forward(before).joints_in_world,
                               model_->forward(h.posture).joints_in_world) > kSame_m)
            h.replaced.push_back(before);
    }
    h.around[arm].clear();
    for (const MovedArm& moved : search.around(kDoubtfulMove_rad))
        h.around[arm].push_back({moved.posture, moved.total() - search.best().total()});
}

void PoseTracker::turn_feet(Hypothesis& h, std::span<const SilhouetteRays> views) {
    constexpr int kSteps = 1;  // each frame set starts from the turns of the one before
    kinevox::turn_feet(*model_, views, options_.fit.narrow_m, kSteps, workspaces_.front().cost, h.posture);
    h.fit.posture = h.posture;
}

// A start that faces the wrong way is not lost, and no search of limbs corrects it.
void PoseTracker::check_turned(Hypothesis& h, std::span<const SilhouetteRays> views, double seconds) {
    turn_wait_s_ -= seconds;
    if (turn_wait_s_ > 0) return;
    turn_wait_s_ = kTurnInterval_s;
    Workspace& work = workspaces_.front();
    PoseFit fit = work.fitter.fit(*model_, views, turned(*model_, h.posture), nullptr, true);
    fit = work.fitter.fit(*model_, views, fit.posture, nullptr, true);
    const double gain = free_fit(work, h, views, h.posture).cost - fit.at.cost;
    const double before = turned_ ? turned_->cost_above : -gain;
    turned_ = {fit.posture, kTurnMemory * before - (1 - kTurnMemory) * gain};
    turned_->posture.root_in_world = fit.posture.root_in_world - h.posture.root_in_world;
    turn_evidence_ = std::max(0.0, kTurnMemory * turn_evidence_ + gain);
    if (turn_evidence_ < kTurnEvidence || gain <= 0) return;
    turn_evidence_ = 0;
    turned_.reset();
    replace(h, std::move(fit));
    // The trunk's twist and the limbs were found for the other body.
    BodyPosture straight = h.posture;
    straight.parent_from_segment[kThorax] = Mat3{};
    try_moved(work, h, views, straight, kBetter);
    search_all(work, h, views);
    usual_explained_ = 0;
}

// Where limbs that no search finds leave much of the contour unexplained, the trunk is wrong, too.
void PoseTracker::check_doubtful(Hypothesis& h, std::span<const SilhouetteRays> views, Vec3 centre,
                                 double seconds) {
    doubt_wait_s_ -= seconds;
    if (doubt_wait_s_ > 0) return;
    // Among others, limbs that no search finds may be theirs; a body that explains little is wrong anyway.
    const bool limbs_are_missing = !shows_others(views) && h.fit.unexplained >= kDoubtfulRays &&
                                   h.fit.explained < usual_explained_ - kDoubtfulFraction;
    if (!limbs_are_missing && h.fit.explained >= kPoorlyExplained) return;
    std::vector<Hypothesis> found = found_at(centre, views, {});
    const auto best = std::ranges::min_element(found, {}, &Hypothesis::cost);
    Workspace& work = workspaces_.front();
    if (best->cost + kClearlyBetter > free_fit(work, h, views, h.posture).cost) {
        doubt_wait_s_ = kDoubtInterval_s;
        return;
    }
    turned_.reset();
    replace(h, std::move(best->fit));
    search_all(work, h, views);
}

void PoseTracker::choose() {
    std::stable_sort(hypotheses_.begin(), hypotheses_.end(),
                     [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; });
    std::vector<Hypothesis> kept;
    std::vector<PosedBody> bodies;
    for (Hypothesis& h : hypotheses_) {
        if (kept.size() >= static_cast<std::size_t>(options_.hypotheses)) break;
        if (!kept.empty() &&
            (h.cost > options_.drop_cost_ratio * kept.front().cost || h.seconds > options_.decide_after_s))
            break;
        PosedBody body = model_->forward(h.posture);
        const bool known = std::any_of(bodies.begin(), bodies.end(), [&](const PosedBody& other) {
            return mean_joint_distance(body, other) < kSame_m;
        });
        if (known) continue;
        bodies.push_back(body);
        kept.push_back(std::move(h));
    }
    hypotheses_ = std::move(kept);
}

TrackedPosture PoseTracker::best() const {
    const Hypothesis& first = hypotheses_.front();
    TrackedPosture tracked{first.fit, first.replaced, {}, first.seconds};
    for (std::size_t k = 0; k < kLimbsOfArms.size(); ++k)  // of the other arm from the frame set before
        for (const JudgedPosture& moved : first.around[k]) {
            const LimbSegments arm = segments_of(kLimbsOfArms[k]);
            tracked.around.push_back({first.fit.posture, moved.cost_above});
            for (const int s : {arm.upper, arm.lower, arm.end})
                tracked.around.back().posture.parent_from_segment[s] = moved.posture.parent_from_segment[s];
        }
    if (is_live() && turned_) {
        tracked.around.push_back(*turned_);
        tracked.around.back().posture.root_in_world += first.fit.posture.root_in_world;
    }
    for (std::size_t k = 1; k < hypotheses_.size(); ++k)
        tracked.alternatives.push_back(hypotheses_[k].fit.posture);
    return tracked;
}

// One limb or pair in turn. `whole`: less is explained than usual.
void PoseTracker::search_next(Hypothesis& h, std::span<const SilhouetteRays> views, bool whole) {
    constexpr double kRounding = 1e-3;
    Workspace& work = workspaces_.front();
    if (intervals_to_pair_ > kRounding || !(whole || h.seconds < kPairSeconds)) {
        search_limb(work, h, views, kLimbs[next_limb_],
                    whole ? LimbSearchScope::kWhole : LimbSearchScope::kLower);
        next_limb_ = (next_limb_ + 1) % static_cast<int>(kLimbs.size());
        return;
    }
    const auto& [first, second] = kLimbPairs[next_pair_];
    search_pair(work, h, views, first, second);
    next_pair_ = (next_pair_ + 1) % kLimbPairs.size();
    intervals_to_pair_ = is_live() ? kPairIntervals : kFrequentPairIntervals;
}

std::optional<TrackedPosture> PoseTracker::update(std::int64_t time_ns, std::span<const SilhouetteRays> views,
                                                  Vec3 centre, std::span<const PoseCandidate> candidates,
                                                  const BodyColours* colours) {
    colours_ = colours;
    const auto seeing =
        std::count_if(views.begin(), views.end(), [](const SilhouetteRays& v) { return v.camera; });
    double seconds = 1 / fps_;
    if (tracking())
        seconds = std::clamp(1e-9 * static_cast<double>(time_ns - last_time_ns_), 0.25 / fps_, 0.5);
    if (seeing < options_.min_views) {
        lost_s_ += seconds;
        if (lost_s_ > options_.lost_after_s) reset();
        return std::nullopt;
    }
    if (!tracking()) {
        begin(views, centre, candidates);
        lost_s_ = usual_explained_ = 0;
        usual_unexplained_ = hypotheses_.front().fit.unexplained;
        usual_interval_s_ = seconds;
        turn_wait_s_ = is_live() ? 0 : kTurnInterval_s;
        turn_evidence_ = doubt_wait_s_ = 0;
        turned_.reset();
        if (is_live()) check_turned(hypotheses_.front(), views, 0);
    } else {
        for (Hypothesis& h : hypotheses_) follow(h, views, seconds);
        // A search of a whole limb takes as long as several fits: it runs only if less is explained than
        // usual for this subject.
        const double explained = hypotheses_.front().fit.explained;
        usual_explained_ = std::max(kept(kUsualMemory, seconds) * usual_explained_, explained);
        const double enough = is_live()
                                  ? std::min(options_.search_explained_fraction, usual_explained_ - kPoorer)
                                  : options_.search_explained_fraction;
        intervals_to_pair_ -= reference_intervals(seconds);
        Hypothesis& best = hypotheses_.front();
        const bool protrudes = is_live() && best.fit.unexplained >= usual_unexplained_ + kProtruding;
        usual_unexplained_ = std::min<double>(
            usual_unexplained_ + kProtrudingRise * reference_intervals(seconds), best.fit.unexplained);
        const std::size_t replaced_before = best.replaced.size();
        if (searches_fully(seconds) || std::exchange(model_changed_, false)) {
            search_all(workspaces_.front(), best, views);
        } else if (!protrudes) {
            search_next(best, views, explained < enough);
        } else if (!search_protruding(best, views)) {
            usual_unexplained_ += kProtrudingRiseInVain * (best.fit.unexplained - usual_unexplained_);
        }
        if (is_live()) {
            if (best.replaced.size() > replaced_before) {  // what was found may have left and right exchanged
                try_other_starts(best, views, best.posture);
                best.posture = best.fit.posture;
            }
            check_doubtful(best, views, centre, seconds);
        }
        check_turned(best, views, seconds);
        if (colours_ && (is_live() || !shows_others(views))) move_arms(best, views);
        choose();
        if (is_live()) turn_feet(hypotheses_.front(), views);
        usual_interval_s_ = kIntervalMemory * usual_interval_s_ + (1 - kIntervalMemory) * seconds;
    }
    last_time_ns_ = time_ns;
    if (hypotheses_.front().fit.explained < options_.lost_explained_fraction) {
        lost_s_ += seconds;
        if (lost_s_ > options_.lost_after_s) reset();
        return std::nullopt;
    }
    lost_s_ = 0;
    return best();
}

}  // namespace kinevox
