// The last stage of the pipeline: measures the pose from the silhouettes of one frame set.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/body_pose.h"
#include "common/camera.h"
#include "server/pose/body_shape.h"
#include "server/pose/main_body.h"
#include "server/pose/pose_candidate.h"
#include "server/pose/pose_estimate.h"
#include "server/pose/pose_options.h"
#include "server/pose/pose_tracker.h"
#include "server/pose/posture_filter.h"

namespace kinevox {

// The evidence of one frame set, for later fits.
struct PoseObservation {
    std::int64_t time_ns = 0;
    Vec3 centre_in_world;
    std::vector<SilhouetteRays> views;
};

// Not thread-safe. The results do not depend on the number of threads.
class PoseStage {
  public:
    PoseStage(std::vector<Camera> cameras, double fps, const PoseStageOptions& options);

    void set_body(const BodyInUse& body);
    BodyInUse body_in_use() const { return {body(), judge_.standing_m(), options_.estimate.body_std_m}; }
    const BodyShape& body() const { return tracker_.model().shape(); }
    // May be null; must outlive the stage. Used when a pose must be found without prior.
    void set_proposer(PoseProposer* proposer) { proposer_ = proposer; }
    PoseProposer* proposer() const { return proposer_; }

    // Views in the order of the cameras; `coarse` is the volume with voxels kCoarseFactor times as large,
    // occupied if any of theirs is. Null if no pose is found.
    static constexpr int kCoarseFactor = 4;
    std::shared_ptr<BodyPose> process(std::uint32_t subject_id, std::uint64_t sequence, std::int64_t time_ns,
                                      std::span<const PoseView> views, const kernels::VoxelVolume& volume,
                                      const kernels::VoxelVolume& coarse, Vec3 centre_in_world);
    // The evidence of the last process().
    const PoseObservation& observation() const { return observation_; }
    // The same from an observation; `time_ns` may decrease in recorded time when tracking backwards.
    std::shared_ptr<BodyPose> process(std::uint32_t subject_id, std::uint64_t sequence, std::int64_t time_ns,
                                      const PoseObservation& observation,
                                      std::span<const PoseCandidate> candidates);
    // Cost of the last posture against the silhouettes, without motion prior; for comparing postures of one
    // frame set.
    double data_cost() const { return data_cost_; }
    // The unfiltered posture of the last frame set.
    const std::optional<TrackedPosture>& tracked() const { return tracked_; }

    void reset();

  private:
    std::vector<WeightedPosture> alternatives(std::span<const SilhouetteRays> views);
    void learn_colours(std::int64_t time_ns, std::span<const SilhouetteRays> views,
                       std::span<const BodyCapsule> capsules);
    void mask_views(const kernels::VoxelVolume& volume, const MainBody& body, std::vector<PoseView>& views);

    std::vector<Camera> cameras_;
    PoseStageOptions options_;
    PoseTracker tracker_;
    PoseCost judge_;
    OneEuroPosture filter_;
    PoseProposer* proposer_ = nullptr;
    std::vector<kernels::Silhouettes> masked_;  // per camera
    std::vector<std::vector<std::uint8_t>> mask_;
    PoseObservation observation_;
    std::optional<TrackedPosture> tracked_;
    double data_cost_ = 0;
    std::shared_ptr<const BodyPose> last_;
    MissingLegs missing_legs_;
    BodyColours colours_;  // of the subject, learned from its poses; not of recordings
    std::int64_t learned_ns_ = 0;
};

}  // namespace kinevox
