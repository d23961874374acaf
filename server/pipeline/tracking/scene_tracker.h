// Tracks several subjects in the visual hull of the whole scene: each connected part of it belongs to the
// subjects whose shapes of the last frame set it contains; a part that belongs to none is a new subject if
// it has the size of a person and explains silhouettes that the others do not (else it is a ghost, where the
// cones of different people's silhouettes intersect).
//
// Order of calls for each frame set: predict(), segmentation with its priors, update().
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/camera.h"
#include "kernels/hull.h"
#include "kernels/segmentation.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pipeline/tracking/occupied_cells.h"
#include "server/pipeline/tracking/subject_memory.h"
#include "server/pipeline/tracking/subject_rules.h"
#include "server/pipeline/tracking/tracker.h"

namespace kinevox {

class SubjectControl;
struct KnownSubject;

// One of several tracked subjects after a frame set.
struct SceneSubject {
    SubjectTrack track;
    std::optional<kernels::Lattice> lattice;  // empty if the frame set does not show it
    std::vector<CameraRole> roles;            // per camera
};

// A person who is tracked but not followed, or just appeared, because they hide and touch those who are.
struct Bystander {
    std::uint32_t id = 0;        // 0: not tracked yet
    kernels::VoxelVolume shape;  // coarse
};

struct SceneUpdate {
    std::vector<SceneSubject> subjects;  // those followed, in the order of their ids
    std::vector<Bystander> bystanders;   // that the frame set shows
    std::vector<Event> events;
};

// Not thread safe.
class SceneTracker {
  public:
    // `control`: an operator's requests; null: none. Must outlive the tracker.
    SceneTracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options,
                 SubjectControl* control = nullptr);

    // Per camera the prior of the segmentation; `expected` stays null.
    std::vector<kernels::SegmentationPrior> predict(std::int64_t time_ns);
    // Expected motion of a subject between the last update and the last predict(), m.
    Vec3 motion(std::uint32_t subject_id) const;

    // One entry per camera; null for a camera without an image. `time_ns` as given to predict(). Without
    // images a person who returns is not recognised.
    SceneUpdate update(std::uint64_t sequence, std::int64_t time_ns,
                       const std::vector<const kernels::Silhouettes*>& silhouettes,
                       std::span<const kernels::ImageView> images = {});

    // After update(): leaves of a volume without colours the part that belongs to this subject.
    void restrict_to(std::uint32_t subject_id, kernels::VoxelVolume& volume) const;

    void reset();

    // Starts without people; new ones have ids above `last_id`. Those remembered stay so.
    void begin(std::uint32_t last_id);
    // Continues with a followed subject, without an event. `shape`: as it was last seen.
    void take_over(const TrackedState& subject, const kernels::VoxelVolume& shape);
    std::uint32_t last_id() const { return last_id_; }
    // Number of people tracked, followed or not, and of those who may be.
    std::size_t people() const { return subjects_.size(); }
    std::size_t newcomers() const { return pending_.size(); }
    // Of the only person tracked, if followed and in the last frame set.
    std::optional<TrackedState> only_subject() const;
    // While Tracker follows a lone subject: remembers who it is, several times per second. Without the images
    // of outlier cameras.
    void observe_lone(const TrackedState& subject, std::int64_t time_ns,
                      const std::vector<const kernels::Silhouettes*>& silhouettes,
                      std::span<const kernels::ImageView> images);
    // While Tracker follows a lone subject: whether its volume is of several people: more than one trunk, or
    // half as large again as `before`, when it was alone (may be empty).
    bool holds_several(const kernels::VoxelVolume& shape, const kernels::VoxelVolume& before);
    // Who the only person is that the last update found.
    Newcomer lone_newcomer(std::int64_t time_ns) const;
    // Those who left and would be recognised.
    std::vector<KnownSubject> absent_subjects(std::int64_t time_ns) const;

  private:
    struct Subject {
        std::uint32_t id = 0;
        std::uint8_t label = 0;
        CentreFilter filter;
        Cells cells;  // the last seen
        CellStatistics shape;
        Vec3 motion;
        double usual_litres = 0;
        Vec3 usual_centre;  // when it last had hardly more
        std::int64_t last_seen_ns = 0;
        bool seen = false;  // in the last update
        Followed followed = Followed::kTooMany;
        std::string found_as;          // in the event when it is followed
        bool followed_before = false;  // and reported
    };
    struct Pending {  // may be a new subject
        Vec3 centre_in_world;
        std::int64_t since_ns = 0;
        Appearance appearance;  // sum since then
    };
    enum class Need : std::uint8_t { kNone, kSomeViews, kManyViews };  // of the silhouettes for a newcomer
    static constexpr double kMaxGrowthRatio = 1.5;                     // of a person's volume
    static constexpr std::uint8_t kNewcomersLabel = 253;               // above those of subjects
    using SilhouettesByCamera = std::vector<const kernels::Silhouettes*>;

    void look_at(const SilhouettesByCamera& silhouettes, std::span<const kernels::ImageView> images);
    bool is_remembering_due(std::int64_t time_ns, double interval_s);
    std::int64_t remembered_since_ns(std::int64_t time_ns) const;
    void carve(const SilhouettesByCamera& silhouettes);
    void carve_in(const kernels::Lattice& lattice, const SilhouettesByCamera& silhouettes);
    void begin_with(Subject& subject, Cells cells, std::int64_t time_ns) const;
    void claim();
    void keep_newcomers();
    Cells without_newcomers(const Subject& subject, Cells own);
    void adopt_small_parts();
    static bool is_upright(const CellStatistics& part);
    bool is_upright(const Cells& part) const { return is_upright(grid_.statistics(part)); }
    bool may_start(const Cells& part) const;
    Need need_of(const Cells& part, const SilhouettesByCamera& silhouettes,
                 std::vector<std::vector<std::uint8_t>>& explained) const;
    void keep_beside(const Cells& person);
    void find_new(std::int64_t time_ns, const SilhouettesByCamera& silhouettes);
    Pending continued(const Cells& person, std::int64_t time_ns) const;
    bool decide(const Pending& newcomer, bool certain, std::int64_t time_ns,
                std::optional<Recognition>& known) const;
    void remember(std::int64_t time_ns);
    static Event event(EventKind kind, const std::string& what, const Subject& subject,
                       std::uint64_t sequence, std::int64_t time_ns);
    void start(const Cells& cells, const std::optional<Recognition>& known, std::int64_t time_ns);
    void measure(std::int64_t time_ns);
    void follow(std::uint64_t sequence, std::int64_t time_ns, SceneUpdate& update);
    void publish(std::int64_t time_ns) const;
    SceneSubject described(const Subject& subject, const SilhouettesByCamera& silhouettes) const;
    void drop_lost(std::uint64_t sequence, std::int64_t time_ns, SceneUpdate& update);
    std::vector<CameraRole> roles_of(const Subject& subject, const SilhouettesByCamera& silhouettes) const;

    std::vector<Camera> cameras_;
    std::vector<kernels::CameraModel> models_;
    double fps_;
    TrackerOptions options_;
    SubjectControl* control_;
    std::unique_ptr<kernels::HullCarver> carver_;
    OccupiedCells grid_;
    kernels::VoxelVolume hull_;
    std::vector<Subject> subjects_;  // in the order of their ids
    std::vector<Pending> pending_, still_pending_;
    std::vector<Cells> beside_;          // people who appeared next to subjects, not tracked yet
    std::vector<AppearanceView> views_;  // of the current frame set; empty without images
    SubjectMemory memory_;
    std::int64_t last_remembered_ns_ = 0;
    std::uint32_t last_id_ = 0;
    std::int64_t last_time_ns_ = 0;
    std::uint64_t predictions_ = 0;
    bool whole_images_ = true;  // searched in the current frame set
};

}  // namespace kinevox
