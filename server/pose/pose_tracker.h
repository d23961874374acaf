// Tracks the posture from frame set to frame set: predicts and fits it, keeps several hypotheses until one
// has explained the silhouettes better for some time, and re-initialises if none does.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/pose/body_colours.h"
#include "server/pose/body_model.h"
#include "server/pose/limb_search.h"
#include "server/pose/pose_candidate.h"
#include "server/pose/pose_fitter.h"
#include "server/pose/pose_options.h"

namespace kinevox {

struct JudgedPosture {
    BodyPosture posture;
    double cost_above = 0;  // that of the tracked posture, colours included
};
struct TrackedPosture {
    PoseFit fit;
    std::vector<BodyPosture> alternatives;  // also considered in this frame set
    std::vector<JudgedPosture> around;      // with an arm that is elsewhere, or facing the other way
    double seconds = 0;                     // since it was found
};

// `seconds` in intervals of a frame set at 24 to 31 per second, each of which counts as one: what the tracker
// remembers and allows was measured there, and lasts equally long at any other rate.
double reference_intervals(double seconds);

// Not thread-safe.
class PoseTracker {
  public:
    PoseTracker(double fps, const PoseTrackerOptions& options = {});

    void set_model(std::shared_ptr<const BodyModel> model) {
        model_ = std::move(model);
        model_changed_ = tracking();
        turned_.reset();
    }
    const BodyModel& model() const { return *model_; }
    void set_standing(double standing_m);  // as in PoseCostOptions

    // Views with a null camera are ignored. `candidates` may be empty. `colours` are the subject's; null:
    // only silhouettes count. Nothing if too few cameras see the subject or no pose explains the silhouettes.
    std::optional<TrackedPosture> update(std::int64_t time_ns, std::span<const SilhouetteRays> views,
                                         Vec3 centre_in_world, std::span<const PoseCandidate> candidates,
                                         const BodyColours* colours = nullptr);
    void reset() { hypotheses_.clear(); }
    bool tracking() const { return !hypotheses_.empty(); }

  private:
    // Of the fit without a prior from a posture in this frame set.
    struct FreeFit {
        BodyPosture start;
        double cost = 0, colour_cost = 0;
        double total() const { return cost + colour_cost; }
    };
    struct Hypothesis {
        BodyPosture posture;
        BodyStep rate{};  // 1/s
        double cost = 0;  // running mean
        double seconds = 0;
        PoseFit fit;
        std::optional<FreeFit> free;        // the latest: the searches compare with the same one
        std::vector<BodyPosture> replaced;  // fits of the last frame set that a better one replaced
        std::array<std::vector<JudgedPosture>, 2> around;  // as in TrackedPosture, of each arm
    };

    struct Workspace {
        explicit Workspace(const PoseFitOptions& options) : fitter(options), cost(options.cost) {}
        void set_standing(double standing_m) {
            fitter.set_standing(standing_m);
            cost.set_standing(standing_m);
        }
        PoseFitter fitter;
        PoseCost cost;
        LimbSearch limbs;
    };

    template <typename F>
    void in_parallel(std::size_t count, const F& body);
    std::vector<Hypothesis> found_at(Vec3 centre, std::span<const SilhouetteRays> views,
                                     std::span<const PoseCandidate> candidates);
    void begin(std::span<const SilhouetteRays> views, Vec3 centre, std::span<const PoseCandidate> candidates);
    void check_doubtful(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, Vec3 centre,
                        double seconds);
    // Otherwise a pass over a recording, whose postures retrack() examines again.
    bool is_live() const { return !options_.always_search_limbs; }
    bool searches_fully(double seconds) const;
    void follow(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, double seconds);
    bool try_other_starts(Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                          const BodyPosture& carried);
    void search_limb(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                     Limb limb, LimbSearchScope scope);
    void try_mirrored_elbow(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                            Limb arm);
    void try_arm_elsewhere(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                           Limb arm);
    void search_pair(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                     Limb first, Limb second);
    void search_all(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views);
    void search_next(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, bool whole);
    bool search_protruding(Hypothesis& hypothesis, std::span<const SilhouetteRays> views);
    template <typename Search>
    bool try_searches(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, std::size_t count,
                      double gain, const Search& search);
    const FreeFit& free_fit(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                            const BodyPosture& start);
    void try_moved(Workspace& work, Hypothesis& hypothesis, std::span<const SilhouetteRays> views,
                   const std::optional<BodyPosture>& moved, double gain);
    static void replace(Hypothesis& hypothesis, PoseFit fit);
    void move_arms(Hypothesis& hypothesis, std::span<const SilhouetteRays> views);
    // Where `starts` is not 0, also from this number of its other configurations.
    void move_arm(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, std::size_t arm,
                  std::span<const double> angles, int max_moves, std::size_t starts);
    double colour_cost(std::span<const SilhouetteRays> views, const BodyPosture& posture) const {
        return colours_ ? colours_->cost(views, *model_, posture) : 0;
    }
    void turn_feet(Hypothesis& hypothesis, std::span<const SilhouetteRays> views);
    void check_turned(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, double seconds);
    void choose();
    TrackedPosture best() const;

    double fps_;
    PoseTrackerOptions options_;
    std::shared_ptr<const BodyModel> model_;
    const BodyColours* colours_ = nullptr;  // during update()
    bool model_changed_ = false;            // since the last update of a tracked body
    std::vector<Workspace> workspaces_;     // one per parallel task
    int next_limb_ = 0;
    double intervals_to_pair_ = 0;  // reference intervals until the next search of a pair
    std::size_t next_pair_ = 0;
    std::size_t next_move_ = 0;  // of move_arms()
    double usual_explained_ = 0;
    double usual_unexplained_ = 0;  // see PoseFit::unexplained
    double usual_interval_s_ = 0;
    double turn_wait_s_ = 0, turn_evidence_ = 0;  // of check_turned()
    std::optional<JudgedPosture> turned_;         // of its last fit, its root from the tracked one, mean cost
    double doubt_wait_s_ = 0;                     // of check_doubtful()
    std::vector<Hypothesis> hypotheses_;          // the best one first
    std::int64_t last_time_ns_ = 0;
    double lost_s_ = 0;
};

}  // namespace kinevox
