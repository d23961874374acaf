#include "server/pose/retrack.h"

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/parallel_invoke.h>

#include <algorithm>
#include <array>
#include <limits>
#include <utility>

#include "common/median.h"
#include "server/pose/arm_search.h"
#include "server/pose/body_colours.h"
#include "server/pose/each_run.h"
#include "server/pose/foot_turn.h"
#include "server/pose/limb_search.h"
#include "server/pose/pose_fitter.h"
#include "server/pose/pose_path.h"
#include "server/pose/turned_posture.h"

namespace kinevox {
namespace {

constexpr int kSweeps = 2;  // of fits between the neighbours
constexpr double kMinInterval_s = 1e-3;
constexpr std::size_t kMaxCandidates = 8;
constexpr double kHopeless = 80;  // a candidate that costs more than the cheapest by this is dropped

constexpr double kPoor = 1.4;  // a path's cost that suggests a lost body, in medians
// Of a path beside other people, whose silhouettes explain a limb anywhere: cost relative to the path so far.
constexpr double kMuchBetter = 0.7;

constexpr double kSameLimb_m = 0.08;  // limbs with no joint of joints_of() farther apart are one
constexpr double kLimbGain = 10, kArmGainAmongOthers = 30;  // min. decrease of the path's cost per frame set
constexpr std::size_t kLimbStarts = 3;  // other limbs that are fitted per frame set, those that match best

constexpr std::array<double, 3> kPathArmMoves_rad{0.6, 0.3, 0.15};  // of move_arms(), as are the next lines
constexpr int kMaxArmMoves = 4;                                     // by each angle
constexpr std::size_t kPathArmStarts = 4;    // of a search anywhere, those that match best
constexpr std::size_t kMovedCandidates = 2;  // per frame set

// Near the ends of a path silent errors are ten times as frequent (random trials of one and several people).
constexpr std::size_t kEndFrames = 2;
constexpr double kEndLogOdds = 2.5;

constexpr std::array<double, 4> kForearmTurns{-1, -0.5, 0.5, 1};  // rad, see forearm_turned()
constexpr std::size_t kTurnViews = 4, kTurnStarts = 4;            // maxima: evenly spread; best ones

bool cheaper(const PathCandidate& a, const PathCandidate& b) {
    return a.total() < b.total();
}

// Those that show where a limb is, elbow and wrist or knee and ankle. Hands and feet differ everywhere.
std::array<std::size_t, 2> joints_of(const LimbSegments& limb) {
    return {origin_joint(limb.lower), origin_joint(limb.end)};
}

// The candidate postures of a recording and the path through them.
class Recording {
  public:
    Recording(std::span<const RecordedView> frames, const PoseStageOptions& options, std::stop_token stop)
        : recorded_(frames),
          options_(options),
          stop_(std::move(stop)),
          model_(options.body),
          frames_(frames.size()),
          arms_moved_(frames.size()) {
        double last_s = -std::numeric_limits<double>::infinity();
        for (std::size_t n = 0; n < frames.size(); ++n) {
            if (!frames[n].seen) continue;
            frames_[n].time_s =
                std::max(1e-9 * static_cast<double>(frames[n].seen->time_ns), last_s + kMinInterval_s);
            last_s = frames_[n].time_s;
        }
    }

    void add_pass(const std::vector<Camera>& cameras, double fps, const PoseStageOptions& options,
                  bool backwards, std::vector<std::vector<BodyPosture>>& found) const {
        PoseStage stage(cameras, fps, options);
        found.resize(recorded_.size());
        for (std::size_t k = 0; k < recorded_.size() && !stop_.stop_requested(); ++k) {
            const std::size_t n = backwards ? recorded_.size() - 1 - k : k;
            const PoseObservation* seen = recorded_[n].seen;
            if (!seen) {
                stage.reset();
                continue;
            }
            const std::int64_t time_ns = backwards ? -seen->time_ns : seen->time_ns;
            if (!stage.process(0, 0, time_ns, *seen, {})) continue;
            found[n].push_back(stage.tracked()->fit.posture);
            for (const BodyPosture& other : stage.tracked()->alternatives) found[n].push_back(other);
        }
    }
    void add(std::size_t n, std::span<const BodyPosture> postures) {
        PoseCost cost(options_.tracker.fit.cost);
        for (const BodyPosture& posture : postures) add(n, candidate(n, posture, cost));
    }

    void choose() { choices_ = choose_path(frames_); }

    // From the postures on the path; all candidates are weighed again.
    void learn_colours() {
        std::vector<BodyColours::Example> examples(frames_.size());
        each([&](std::size_t n) {
            examples[n].views = views_of(n);
            model_.capsules(model_.forward(*chosen(n)), examples[n].capsules);
        });
        colours_.learn(examples);
        each([&](std::size_t n) {
            std::vector<BodyCapsule> capsules;
            for (PathCandidate& c : frames_[n].candidates) {
                model_.capsules(model_.forward(c.posture), capsules);
                c.colour_cost = colours_.cost(views_of(n), capsules);
            }
        });
    }

    // Fits from starts_around() each frame set; one that approaches a known candidate ends there.
    void search_around_path() {
        std::vector<std::vector<PathCandidate>> found(frames_.size());
        searched_.resize(frames_.size());
        each([&](std::size_t n) {
            PoseFitter fitter(options_.tracker.fit);
            PoseCost cost(options_.tracker.fit.cost);
            const double known_cost = fitter.cost_of(model_, views_of(n), *chosen(n));
            for (const BodyPosture& start : starts_around(n, known_cost, fitter)) {
                const PoseFit near = fitter.approach(model_, views_of(n), start, nullptr);
                if (near.at.cost > max_approached_cost(known_cost)) continue;
                const JointPositions joints = model_.forward(near.posture).joints_in_world;
                if (is_known(joints, frames_[n].candidates) || is_known(joints, found[n])) continue;
                const PoseFit fit = fitter.fit(model_, views_of(n), near.posture, nullptr, false);
                PathCandidate c = without_colours(n, fit.posture, cost);
                if (c.cost > chosen_cost(n) + kHopeless || is_worse(c, frames_[n].candidates) ||
                    is_worse(c, found[n]))
                    continue;
                c.colour_cost = colours_.cost(views_of(n), cost.capsules());
                found[n].push_back(c);
            }
        });
        each([&](std::size_t n) { searched_[n] = *chosen(n); });
        add_all(found);
    }

    // Colours show where an arm before the trunk is, silhouettes hardly: moves the arms of the cheapest
    // candidates, and searches them anywhere in the silhouettes.
    void move_arms() {
        std::vector<std::vector<PathCandidate>> found(frames_.size());
        each([&](std::size_t n) {
            const double min_gain = shows_others(n) ? kArmGainAmongOthers : kLimbGain;
            PoseCost cost(options_.tracker.fit.cost);
            LimbSearch limbs;
            std::vector<BodyPosture> starts{*chosen(n)};
            for (const PathCandidate& c : frames_[n].candidates)
                if (starts.size() < kMovedCandidates && c.posture != starts[0]) starts.push_back(c.posture);
            for (const BodyPosture& start : starts) {
                if (std::ranges::count(arms_moved_[n], start) > 0) continue;
                arms_moved_[n].push_back(start);
                BodyPosture moved = start;
                for (const Limb arm : {Limb::kArmL, Limb::kArmR}) {
                    ArmSearch search(model_, moved, arm, views_of(n), colours_, options_.tracker.fit);
                    search.improve(kPathArmMoves_rad, kMaxArmMoves);
                    search.improve_anywhere(limbs, kPathArmMoves_rad, kMaxArmMoves, kPathArmStarts);
                    if (search.gain() >= min_gain) moved = search.best().posture;
                }
                if (moved != start) found[n].push_back(candidate(n, moved, cost));
            }
        });
        add_all(found);
    }

    // Where the path explains the silhouettes much worse than elsewhere, the passes lost the body: fits from
    // the frame sets on either side on, each expected to continue the motion of the two before it.
    void bridge() {
        const double poor = kPoor * median_cost();
        const auto is_poor = [&](std::size_t n) { return chosen(n) && chosen_cost(n) > poor; };
        std::vector<std::array<std::size_t, 2>> runs;
        each_run(frames_.size(), is_poor, [&](std::size_t first, std::size_t end) {
            runs.push_back({first, end});
        });
        std::array<std::vector<std::vector<PathCandidate>>, 2> found;
        for (auto& each : found) each.resize(runs.size());
        oneapi::tbb::parallel_for(std::size_t{0}, runs.size(), [&](std::size_t k) {
            const auto [first, end] = runs[k];
            found[0][k] = continued(first, 1, end - first);
            found[1][k] = continued(end - 1, -1, end - first);
        });
        for (std::size_t k = 0; k < runs.size(); ++k)
            for (const bool backwards : {false, true}) {
                const std::vector<PathCandidate>& chain = found[backwards][k];
                const auto frame_of = [&](std::size_t n) {
                    return backwards ? runs[k][1] - 1 - n : runs[k][0] + n;
                };
                double before = 0, after = 0;
                bool among_others = false;
                for (std::size_t n = 0; n < chain.size(); ++n) {
                    before += chosen_cost(frame_of(n)), after += chain[n].cost;
                    among_others |= shows_others(frame_of(n));
                }
                if (among_others && after > kMuchBetter * before) continue;
                for (std::size_t n = 0; n < chain.size(); ++n) add(frame_of(n), chain[n]);
            }
    }

    // Each search finds some of the limbs: a path for each limb through those of all candidates, the rest of
    // the body as on the path so far.
    void recombine_limbs() {
        std::vector<PathCandidate> path(frames_.size());
        each([&](std::size_t n) { path[n] = frames_[n].candidates[choices_[n].candidate]; });
        for (const Limb limb : kLimbs) {
            std::vector<PathFrame> found(frames_.size());
            each([&](std::size_t n) {
                PoseFitter fitter(options_.tracker.fit);
                PoseCost cost(options_.tracker.fit.cost);
                found[n] = {frames_[n].time_s, {path[n]}};
                std::vector<PathCandidate> starts;
                for (const BodyPosture& start : with_other_limbs(n, limb, path))
                    starts.push_back(candidate(n, start, cost));
                std::stable_sort(starts.begin(), starts.end(), cheaper);
                starts.resize(std::min(starts.size(), kLimbStarts));
                for (const PathCandidate& start : starts) {
                    const PoseFit fit = fitter.fit(model_, views_of(n), start.posture, nullptr, false);
                    found[n].candidates.push_back(candidate(n, fit.posture, cost));
                    found[n].candidates.back().cost += kLimbGain;
                }
            });
            const std::vector<PathChoice> choices = choose_path(found);
            for (std::size_t n = 0; n < frames_.size(); ++n)
                if (choices[n].candidate > 0) {
                    path[n] = found[n].candidates[choices[n].candidate];
                    path[n].cost -= kLimbGain;
                }
        }
        for (std::size_t n = 0; n < frames_.size(); ++n)
            if (choices_[n].candidate >= 0) keep(n, path[n]);
    }

    // Each posture again, expected between its neighbours: what its silhouettes do not determine comes from
    // them. Alternately the even and the odd ones, so that the order does not matter.
    void smooth() {
        path_.assign(frames_.size(), std::nullopt);
        for (std::size_t n = 0; n < frames_.size(); ++n)
            if (const BodyPosture* posture = chosen(n)) path_[n] = *posture;
        turn_feet();
        for (int half = 0; half < 2 * kSweeps; ++half)
            each([&](std::size_t n) {
                if (static_cast<int>(n % 2) != half % 2 || n == 0 || n + 1 >= path_.size() || !path_[n - 1] ||
                    !path_[n + 1])
                    return;
                const MotionPrior prior = expected_between(n);
                PoseFitter fitter(options_.tracker.fit);
                path_[n] = fitter.fit(model_, views_of(n), *path_[n], &prior, false).posture;
            });
        turn_feet();
    }

    std::vector<RetrackedFrame> describe(int cameras) const {
        std::vector<RetrackedFrame> result(frames_.size());
        const std::vector<LegFlags> missing = find_missing_legs();
        const std::vector<double> exchanged_legs = exchanged_legs_probability(frames_, choices_);
        each([&](std::size_t n) {
            PoseCost cost(options_.tracker.fit.cost);
            auto pose = std::make_shared<BodyPose>();
            pose->subject_id = recorded_[n].subject_id;
            pose->sequence = recorded_[n].sequence;
            pose->capture_time_ns = recorded_[n].seen->time_ns;
            Linearisation data;
            cost.linearise(model_, *path_[n], views_of(n), nullptr, options_.tracker.fit.narrow_m, data);
            pose->contour_residual_rms_m = contour_fit(cost.terms(), options_.tracker.fit.narrow_m).rms_m;
            std::vector<WeightedPosture> others;
            for (std::size_t k = 0; k < frames_[n].candidates.size(); ++k)
                others.push_back({frames_[n].candidates[k].posture, choices_[n].probability[k]});
            others.push_back({exchanged(*path_[n], kLegSegments), exchanged_legs[n]});
            EstimateOptions estimate = options_.estimate;
            if (is_at_end(n)) estimate.gross_log_odds += kEndLogOdds;
            judge_posture(model_, *path_[n], data, views_of(n), cost.terms(), cost.capsules(), others,
                          cameras, estimate, *pose);
            withhold_legs(missing[n], *pose);
            describe_posture(model_, *path_[n], *pose);
            result[n] = {*path_[n], std::move(pose), choices_[n].probability[choices_[n].candidate]};
        });
        for (std::size_t n = 1; n < result.size(); ++n)
            if (result[n].pose && result[n - 1].pose) set_velocities(*result[n - 1].pose, *result[n].pose);
        return result;
    }

  private:
    // Over the frame sets with a posture.
    template <typename F>
    void each(const F& f) const {
        oneapi::tbb::parallel_for(std::size_t{0}, frames_.size(), [&](std::size_t n) {
            if (choices_[n].candidate >= 0 && !stop_.stop_requested()) f(n);
        });
    }
    const std::vector<SilhouetteRays>& views_of(std::size_t n) const { return recorded_[n].seen->views; }
    // Whether few frame sets before or after this one confirm the posture.
    bool is_at_end(std::size_t n) const {
        for (std::size_t k = 1; k <= kEndFrames; ++k)
            if (n < k || n + k >= path_.size() || !path_[n - k] || !path_[n + k]) return true;
        return false;
    }
    void turn_feet() {
        constexpr int kSteps = 4;
        each([&](std::size_t n) {
            PoseCost cost(options_.tracker.fit.cost);
            kinevox::turn_feet(model_, views_of(n), options_.tracker.fit.narrow_m, kSteps, cost, *path_[n]);
        });
    }
    std::vector<LegFlags> find_missing_legs() const {
        std::vector<std::optional<LegSight>> sights(frames_.size());
        std::vector<double> time_s(frames_.size());
        each([&](std::size_t n) { sights[n] = see_legs(model_, *path_[n], views_of(n)); });
        for (std::size_t n = 0; n < frames_.size(); ++n) time_s[n] = frames_[n].time_s;
        return missing_legs(sights, time_s);
    }
    // The postures of the neighbours on the path, and its own with left and right exchanged and with a
    // forearm turned towards or away from a camera: silhouettes alone hardly show which. Only those that have
    // changed since the last search.
    std::vector<BodyPosture> starts_around(std::size_t n, double known_cost, PoseFitter& fitter) const {
        std::vector<BodyPosture> starts;
        const bool before = chosen(n - 1), after = chosen(n + 1);
        const bool new_before = before && has_changed(n - 1), new_after = after && has_changed(n + 1);
        if (new_before) starts.push_back(*chosen(n - 1));
        if (new_after) starts.push_back(*chosen(n + 1));
        if (before && after && (new_before || new_after))
            starts.push_back(between(*chosen(n - 1), *chosen(n + 1), fraction(n)));
        if (!has_changed(n)) return starts;
        for (const LimbSegmentPairs& limbs : {kLegSegments, kArmSegments}) {
            const BodyPosture start = exchanged(*chosen(n), limbs);
            if (fitter.cost_of(model_, views_of(n), start) <= max_exchanged_cost(known_cost))
                starts.push_back(start);
        }
        if (shows_others(n)) return starts;  // whose silhouettes explain a forearm anywhere
        for (const int forearm : {kForearmL, kForearmR})
            for (const BodyPosture& start : with_turned_forearm(n, forearm, fitter)) starts.push_back(start);
        return starts;
    }
    // The posture on the path with a limb of other candidates or of the neighbours.
    std::vector<BodyPosture> with_other_limbs(std::size_t n, Limb limb,
                                              std::span<const PathCandidate> path) const {
        const LimbSegments segments = segments_of(limb);
        const auto same_limb = [joints = joints_of(segments)](const PathCandidate& a,
                                                              const PathCandidate& b) {
            return std::ranges::all_of(joints, [&](std::size_t j) {
                return norm(a.joints_in_world[j] - b.joints_in_world[j]) < kSameLimb_m;
            });
        };
        std::vector<const PathCandidate*> known{&path[n]};
        std::vector<BodyPosture> starts;
        const auto add = [&](const PathCandidate& other) {
            if (std::ranges::any_of(known, [&](const PathCandidate* k) { return same_limb(*k, other); }))
                return;
            known.push_back(&other);
            starts.push_back(path[n].posture);
            for (const int segment : {segments.upper, segments.lower, segments.end})
                starts.back().parent_from_segment[segment] = other.posture.parent_from_segment[segment];
        };
        for (const PathCandidate& other : frames_[n].candidates) add(other);
        if (chosen(n - 1)) add(path[n - 1]);
        if (chosen(n + 1)) add(path[n + 1]);
        return starts;
    }
    // The posture on the path with a forearm turned towards or away from a camera, those that match best.
    std::vector<BodyPosture> with_turned_forearm(std::size_t n, int forearm, PoseFitter& fitter) const {
        const std::vector<SilhouetteRays>& views = views_of(n);
        std::vector<std::pair<double, BodyPosture>> starts;
        const std::size_t stride = (views.size() + kTurnViews - 1) / kTurnViews;
        for (std::size_t c = 0; c < views.size(); c += stride) {
            if (!views[c].camera) continue;
            const Vec3 viewpoint = views[c].contour.origin_in_world;
            for (const double angle : kForearmTurns)
                if (const auto start = forearm_turned(model_, *chosen(n), forearm, viewpoint, angle))
                    starts.emplace_back(fitter.cost_of(model_, views, *start), *start);
        }
        std::ranges::stable_sort(starts, {}, &std::pair<double, BodyPosture>::first);
        std::vector<BodyPosture> best;
        for (std::size_t k = 0; k < std::min(starts.size(), kTurnStarts); ++k)
            best.push_back(starts[k].second);
        return best;
    }
    const BodyPosture* chosen(std::size_t n) const {
        if (n >= frames_.size() || choices_[n].candidate < 0) return nullptr;
        return &frames_[n].candidates[choices_[n].candidate].posture;
    }
    bool has_changed(std::size_t n) const { return searched_[n] != *chosen(n); }
    bool shows_others(std::size_t n) const { return kinevox::shows_others(views_of(n)); }
    double chosen_cost(std::size_t n) const { return frames_[n].candidates[choices_[n].candidate].cost; }
    double median_cost() const {
        std::vector<double> costs;
        for (std::size_t n = 0; n < frames_.size(); ++n)
            if (chosen(n)) costs.push_back(chosen_cost(n));
        return costs.empty() ? 0 : median_of(costs);
    }
    // Fits of `count` frame sets from `first` on, forwards (step 1) or backwards (-1), from the path before
    // them; none at an end of the path.
    std::vector<PathCandidate> continued(std::size_t first, std::ptrdiff_t step, std::size_t count) const {
        std::vector<PathCandidate> fits;
        const BodyPosture* const before = chosen(first - 2 * step);
        const BodyPosture* const last = chosen(first - step);
        if (!before || !last) return fits;
        BodyPosture a = *before, b = *last;
        PoseFitter fitter(options_.tracker.fit);
        PoseCost cost(options_.tracker.fit.cost);
        for (std::size_t k = 0, n = first; k < count; ++k, n += step) {
            const double passed_s = std::abs(frames_[n - step].time_s - frames_[n - 2 * step].time_s);
            const double ahead_s = std::abs(frames_[n].time_s - frames_[n - step].time_s);
            const MotionPrior prior = motion_prior(between(a, b, 1 + ahead_s / passed_s),
                                                   0.5 * ahead_s * (passed_s + ahead_s), options_.tracker);
            const PoseFit fit = fitter.fit(model_, views_of(n), prior.expected, &prior, false);
            fits.push_back(candidate(n, fit.posture, cost));
            a = std::exchange(b, fit.posture);
        }
        return fits;
    }
    double fraction(std::size_t n) const {
        return (frames_[n].time_s - frames_[n - 1].time_s) / (frames_[n + 1].time_s - frames_[n - 1].time_s);
    }
    MotionPrior expected_between(std::size_t n) const {
        const double half =
            0.5 * (frames_[n].time_s - frames_[n - 1].time_s) * (frames_[n + 1].time_s - frames_[n].time_s);
        return motion_prior(between(*path_[n - 1], *path_[n + 1], fraction(n)), half, options_.tracker);
    }
    PathCandidate without_colours(std::size_t n, const BodyPosture& posture, PoseCost& cost) const {
        Linearisation at;
        cost.linearise(model_, posture, views_of(n), nullptr, options_.tracker.fit.narrow_m, at);
        return {posture, at.cost, cost.posed().joints_in_world};
    }
    PathCandidate candidate(std::size_t n, const BodyPosture& posture, PoseCost& cost) const {
        PathCandidate c = without_colours(n, posture, cost);
        c.colour_cost = colours_.cost(views_of(n), cost.capsules());
        return c;
    }
    // Replaces a dearer candidate with the same joints; false if there is none with the same joints.
    bool merge(std::size_t n, const PathCandidate& c) {
        for (PathCandidate& other : frames_[n].candidates)
            if (same_joints(other, c)) {
                if (c.total() < other.total()) other = c;
                return true;
            }
        return false;
    }
    void keep(std::size_t n, const PathCandidate& c) {
        if (!merge(n, c)) frames_[n].candidates.push_back(c);
    }
    void add_all(const std::vector<std::vector<PathCandidate>>& found) {
        for (std::size_t n = 0; n < frames_.size(); ++n)
            for (const PathCandidate& c : found[n]) add(n, c);
    }
    void add(std::size_t n, const PathCandidate& c) {
        if (merge(n, c)) return;
        std::vector<PathCandidate>& known = frames_[n].candidates;
        known.push_back(c);
        std::stable_sort(known.begin(), known.end(), cheaper);
        while (known.size() > kMaxCandidates || known.back().total() > known.front().total() + kHopeless)
            known.pop_back();
    }

    std::span<const RecordedView> recorded_;
    PoseStageOptions options_;
    std::stop_token stop_;
    BodyModel model_;
    std::vector<PathFrame> frames_;
    std::vector<PathChoice> choices_;
    std::vector<std::optional<BodyPosture>> searched_;  // the path around which was searched
    std::vector<std::vector<BodyPosture>> arms_moved_;  // the postures that move_arms() had
    std::vector<std::optional<BodyPosture>> path_;
    BodyColours colours_;
};

}  // namespace

std::vector<RetrackedFrame> retrack(const std::vector<Camera>& cameras, double fps,
                                    std::span<const RecordedView> frames, const PoseStageOptions& options,
                                    int rounds, std::stop_token stop) {
    PoseStageOptions unfiltered = options;
    unfiltered.filtered = false;
    unfiltered.tracker.always_search_limbs = true;
    Recording recording(frames, unfiltered, stop);
    std::array<std::vector<std::vector<BodyPosture>>, 2> found;
    oneapi::tbb::parallel_invoke([&] { recording.add_pass(cameras, fps, unfiltered, false, found[0]); },
                                 [&] { recording.add_pass(cameras, fps, unfiltered, true, found[1]); });
    for (std::size_t n = 0; n < frames.size(); ++n)
        for (const auto& pass : found) recording.add(n, pass[n]);
    recording.choose();
    recording.learn_colours();
    recording.choose();
    for (int round = 0; round < rounds; ++round) {
        recording.search_around_path();
        recording.choose();
        recording.move_arms();
        recording.choose();
        recording.recombine_limbs();
        recording.choose();
        recording.bridge();
        recording.choose();
    }
    recording.smooth();
    return recording.describe(static_cast<int>(cameras.size()));
}

}  // namespace kinevox
