// Tracks the people in the scene: a lone person by Tracker, which takes less time and excludes outlier
// cameras; several, or where rules or requests choose among people, by SceneTracker. It changes between the
// two as other people come and leave, and the subject keeps the id.
//
// Order of calls for each frame set: predict(), segmentation with its priors, update(), restrict_to() and
// observe_volume() for each volume.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pipeline/tracking/scene_tracker.h"
#include "server/pipeline/tracking/tracker.h"

namespace kinevox {

class SubjectControl;

// Not thread safe.
class SubjectTracker {
  public:
    // `control`: an operator's requests; must outlive the tracker.
    SubjectTracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options,
                   SubjectControl& control);

    // Per camera the prior of the segmentation; `expected` stays null.
    std::vector<kernels::SegmentationPrior> predict(std::int64_t time_ns);
    // Expected motion of a subject between the last update and the last predict(), m.
    Vec3 motion(std::uint32_t subject_id) const;
    // Whether people are separated in the frame set of the last predict().
    bool separates() const { return !alone_; }

    // As SceneTracker::update().
    SceneUpdate update(std::uint64_t sequence, std::int64_t time_ns,
                       const std::vector<const kernels::Silhouettes*>& silhouettes,
                       std::span<const kernels::ImageView> images);

    // As SceneTracker::restrict_to().
    void restrict_to(std::uint32_t subject_id, kernels::VoxelVolume& volume) const;
    // The volume of a subject of the last update: its centre of gravity, whether it lacks legs (see
    // missing_legs_space()), and its shape with voxels of about 4 cm.
    void observe_volume(Vec3 centre_in_world, bool legs_missing, const kernels::VoxelVolume& shape);

    // Forgets all people, without an event.
    void reset();

  private:
    using SilhouettesByCamera = std::vector<const kernels::Silhouettes*>;

    bool is_outlier(std::size_t camera) const;
    bool may_be_alone() const;
    void separate();
    void follow_alone();
    void forget_shape();
    std::optional<SceneUpdate> update_first(std::uint64_t sequence, std::int64_t time_ns,
                                            const SilhouettesByCamera& silhouettes,
                                            std::span<const kernels::ImageView> images, Newcomer& newcomer);
    SceneUpdate update_alone(std::uint64_t sequence, std::int64_t time_ns,
                             const SilhouettesByCamera& silhouettes,
                             std::span<const kernels::ImageView> images, const Newcomer& newcomer);
    SceneUpdate update_scene(std::uint64_t sequence, std::int64_t time_ns,
                             const SilhouettesByCamera& silhouettes,
                             std::span<const kernels::ImageView> images);
    bool sees_others(std::int64_t time_ns, const SilhouettesByCamera& silhouettes);
    void publish(const SceneUpdate& update) const;

    std::vector<Camera> cameras_;
    TrackerOptions options_;
    SubjectControl* control_;
    Tracker tracker_;
    SceneTracker scene_;
    bool alone_;                // Tracker tracks
    bool others_seen_ = false;  // beside the subject, in the last update
    std::int64_t last_others_ns_ = 0;
    std::int64_t last_alone_ns_ = 0;                  // time of the last frame set that Tracker tracked
    Vec3 motion_;                                     // of the lone subject
    std::vector<kernels::SegmentationPrior> priors_;  // of the current frame set
    std::vector<std::int64_t> person_outside_ns_;     // per camera, when it last showed one; 0: not since
    std::vector<std::int64_t> excluded_since_ns_;     // per camera, while Tracker tracked
    // Of the lone subject in the last frame set whose volume had no other person.
    kernels::VoxelVolume shape_;  // coarse
    std::optional<TrackedState> state_;
};

}  // namespace kinevox
