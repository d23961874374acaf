// Follows the posture from frame set to frame set: predicts it, fits it, keeps rival explanations alive until one of
// them has explained the silhouettes better for some time, and begins anew where none does.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_candidate.h"
#include "server/pose/pose_fitter.h"

namespace kinevox {

struct PoseTrackerOptions {
    PoseFitOptions fit;
    SilhouetteRayOptions rays;
    int headings = 16;               // tried for each key pose at the beginning
    int starts = 10;                 // of all those the best are fitted
    int hypotheses = 3;              // and of these so many are followed
    double decide_after_s = 1.0;     // then the best one alone
    double hopeless = 1.35;          // a rival whose cost is so many times the best one's is dropped at once
    double lost_below = 0.55;        // part of the contour explained; below it a pose is lost
    double lost_after_s = 0.15;      // for so long, and the search begins anew
    int min_views = 2;               // with a silhouette
    // Accelerations that the motion prior expects, one standard deviation.
    double root_acceleration_m_s2 = 15, root_turn_rad_s2 = 40, joint_turn_rad_s2 = 90;

    std::string check() const;
};

struct TrackedPosture {
    PoseFit fit;
    double seconds_tracked = 0;
    bool decided = false;            // one hypothesis only
};

// Not thread safe.
class PoseTracker {
  public:
    PoseTracker(double fps, const PoseTrackerOptions& options = {});

    void set_model(std::shared_ptr<const BodyModel> model) { model_ = std::move(model); }
    const BodyModel& model() const { return *model_; }

    // Views without a camera see nothing. `candidates` may be empty. Nothing where too few cameras see the subject or
    // no pose explains what they see.
    std::optional<TrackedPosture> update(std::int64_t time_ns, std::span<const SilhouetteRays> views,
                                         Vec3 centre_in_world, std::span<const PoseCandidate> candidates);
    void reset() { hypotheses_.clear(); }
    bool tracking() const { return !hypotheses_.empty(); }
    const PoseFitter& fitter() const { return fitter_; }

  private:
    struct Hypothesis {
        BodyPosture posture;
        BodyStep rate{};                 // 1/s
        double cost = 0;                 // running mean
        double seconds = 0;
        PoseFit fit;
    };

    void begin(std::span<const SilhouetteRays> views, Vec3 centre, std::span<const PoseCandidate> candidates);
    void follow(Hypothesis& hypothesis, std::span<const SilhouetteRays> views, double seconds);
    void choose();

    double fps_;
    PoseTrackerOptions options_;
    std::shared_ptr<const BodyModel> model_;
    PoseFitter fitter_;
    std::vector<Hypothesis> hypotheses_;   // the best one first
    std::int64_t last_time_ns_ = 0;
    double lost_s_ = 0;
};

}  // namespace kinevox
