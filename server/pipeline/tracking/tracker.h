// Tracks the subject's 3-D bounding box from frame set to frame set: finds it in the silhouettes, filters its
// centre with a Kalman filter, and predicts each camera's search region and the lattice of the hull.
//
// Order of calls for each frame set: predict(), segmentation with its regions, update(), and observe_volume()
// where a volume was carved.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/camera.h"
#include "kernels/option_list.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/tracking/blobs.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pipeline/tracking/subject_centre.h"
#include "server/pipeline/tracking/subject_rules.h"

namespace kinevox {

struct TrackerOptions {
    int max_subjects = 1;
    double recognise_within_s = 600;
    SubjectRules rules;
    double voxel_m = 0.01;
    double margin_m = 0.03;
    double max_lattice_side_m = 2.5;  // arms spread are 1.9 m
    double limb_speed_m_per_s = 4;
    double region_margin_m = 0.12;
    double full_pass_interval_s = 0.5;
    double lost_after_s = 0.5;
    double confirm_score = 1.6;
    double confirm_s = 0.06;
    double min_score = 0.7;
    int report_after_frames = 5;
    // Silhouettes carry no depth: their rays intersect beside the centre of a body that is long towards a
    // camera (a sprinter on the blocks: 8 cm). The centres of the previous volumes show the difference.
    double shape_offset_gain = 0.2;
    double max_shape_offset_m = 0.15;
    RayIntersectionOptions ray_intersection;
    CentreFilterOptions filter;

    // Whether several may be followed, each with a body of its own; else all tracked ones are one person.
    bool several_subjects() const { return max_subjects > 1; }
    // Whether SceneTracker (scene_tracker.h) always replaces Tracker, since people are to be chosen among.
    bool whole_scene() const { return rules != SubjectRules{}; }
    // Whether one person is followed, any one.
    bool one_person() const { return !several_subjects() && !whole_scene(); }
    // Empty when usable, else one sentence.
    std::string check() const;
    bool operator==(const TrackerOptions&) const = default;
};

inline constexpr std::array<std::string_view, 2> kFollowRules{"first", "nearest"};

// All but voxel_m, which is the pipeline's, and of the rules the points and regions.
template <typename T, typename F>
requires kernels::SameOptions<T, TrackerOptions>
void visit_options(T& o, F&& f) {
    f({"max_subjects", 1, 16, "", "Maximum number of subjects followed at once."}, o.max_subjects);
    f(kernels::text_option("follow", "Who is followed if there are more people than max_subjects.",
                           kFollowRules),
      o.rules.follow);
    f({"recognise_within_s", 0, 86400, "s",
       "Absence after which a returning person is a new subject; 0: always."},
      o.recognise_within_s);
    f({"margin_m", 0, 1, "m", "Margin of the lattice around the subject."}, o.margin_m);
    f({"max_lattice_side_m", 0.5, 10, "m", "Maximum side of the lattice; a longer one is cropped."},
      o.max_lattice_side_m);
    f({"limb_speed_m_per_s", 0, 50, "m/s", "Speed of limbs relative to the centre, for the search region."},
      o.limb_speed_m_per_s);
    f({"region_margin_m", 0, 5, "m", "Margin of the search region."}, o.region_margin_m);
    f({"full_pass_interval_s", 0, 60, "s", "Interval at which each whole image is searched."},
      o.full_pass_interval_s);
    f({"lost_after_s", 1e-3, 60, "s", "Time without a measurement until the subject is lost."},
      o.lost_after_s);
    f({"confirm_score", 0, 1000, "", "Score at which a subject is tracked at once."}, o.confirm_score);
    f({"confirm_s", 0, 60, "s",
       "Time in which all frame sets show a subject, until it is tracked with a lower score."},
      o.confirm_s);
    f({"min_score", 0, 1000, "", "Minimum score of a subject."}, o.min_score);
    f({"report_after_frames", 1, 1000, "frame sets",
       "Consecutive frame sets after which an excluded or included camera is reported."},
      o.report_after_frames);
    f({"shape_offset_gain", 0, 1, "", "Gain of the offset between silhouettes' and volume's centre; 0: off."},
      o.shape_offset_gain);
    f({"max_shape_offset_m", 0, 1, "m", "Maximum of that offset."}, o.max_shape_offset_m);
    auto& ray = o.ray_intersection;
    f({"ray_tolerance_m", 1e-3, 10, "m", "Distance from the centre at which a ray is an outlier."},
      ray.tolerance_m);
    f({"truncated_ray_tolerance_m", 1e-3, 10, "m", "The same for a truncated silhouette."},
      ray.truncated_tolerance_m);
    f({"ray_std_m", 1e-4, 1, "m", "Standard deviation of the rays around the centre."}, ray.ray_std_m);
    f({"subject_area_m2", 1e-3, 100, "m2", "Silhouette area from which a ray has the full weight."},
      ray.subject_area_m2);
    f({"min_area_m2", 0, 100, "m2", "Minimum silhouette area of a person."}, ray.min_area_m2);
    f({"max_area_m2", 0, 100, "m2", "Maximum silhouette area of a person."}, ray.max_area_m2);
    f({"acceleration_std_m_per_s2", 1e-3, 1000, "m/s2", "Standard deviation of the centre's acceleration."},
      o.filter.acceleration_std_m_per_s2);
    f({"initial_speed_std_m_per_s", 1e-3, 1000, "m/s", "Standard deviation of a new subject's speed."},
      o.filter.initial_speed_std_m_per_s);
}

// A camera's contribution to the result of a frame set.
enum class CameraRole {
    kInlier,     // its ray determines G and its silhouette carves
    kTruncated,  // its image border cuts the subject: carves, low weight for G
    kOutOfView,  // the subject is outside its image: neither
    kExcluded,   // should see the subject, but its silhouette is inconsistent: neither
    kNoImage,    // neither
};

struct TrackerUpdate {
    std::optional<SubjectTrack> subject;      // empty while no subject is tracked
    std::optional<kernels::Lattice> lattice;  // empty while there is no measurement to carve
    std::vector<CameraRole> roles;            // per camera; kOutOfView while no subject is tracked
    std::vector<Event> events;
};

// Beyond the time that confirms a subject, while it is undecided who it is.
constexpr double kMaxUndecided_s = 0.2;

// Who may be found while no subject is tracked.
struct Newcomer {
    std::uint32_t id = 0;            // a subject that returns; 0: a new one
    std::string found_as = "found";  // in the event
    bool undecided = false;          // who it is; it is found a little later
};

// What another tracker needs to continue with a subject.
struct TrackedState {
    std::uint32_t id = 0;
    CentreFilter filter;
    Box3 box_in_world;
    std::int64_t time_ns = 0;           // of the filter's state
    std::int64_t last_measured_ns = 0;  // the subject was seen
};

// Not thread safe.
class Tracker {
  public:
    Tracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options = {});

    // Per camera the prior of the segmentation at this time; `expected` stays null, and `max_distance_px` is
    // from the subject's own contour. `motion`, if given, is the subject's expected motion since the last
    // update, m.
    std::vector<kernels::SegmentationPrior> predict(std::int64_t time_ns, Vec3* motion = nullptr);

    // One entry per camera; null for a camera without an image. `time_ns` as given to predict().
    TrackerUpdate update(std::uint64_t sequence, std::int64_t time_ns,
                         const std::vector<const kernels::Silhouettes*>& silhouettes,
                         const Newcomer& newcomer = {});

    // The centre of gravity of the volume carved from the last update's lattice, and whether it lacks
    // legs, see missing_legs_space().
    void observe_volume(Vec3 centre_in_world, bool legs_missing);

    bool tracking() const { return tracking_; }
    // Forgets the subject, without an event.
    void reset();

    // Empty while no subject is tracked.
    std::optional<TrackedState> subject() const;
    // Continues with a subject, if given, without an event; later ones have ids above `last_id`.
    void take_over(const std::optional<TrackedState>& subject, std::uint32_t last_id);
    std::uint32_t last_id() const { return last_id_; }

  private:
    struct CameraState {
        bool no_image = false, excluded = false;  // as reported
        int outlier_count = 0, inlier_count = 0;  // consecutive frame sets
    };
    using BlobsByCamera = std::vector<std::vector<Blob>>;

    std::int64_t min_pixels(const Camera& camera) const;
    double search_margin_m(double seconds) const;
    Box3 search_box(double seconds) const;
    RayCandidate candidate(int camera, const Blob& blob) const;
    std::optional<RayIntersection> find_intersection(const BlobsByCamera& blobs,
                                                     std::vector<std::optional<Blob>>& chosen) const;
    std::optional<RayIntersection> gather(const BlobsByCamera& blobs, const Box3& around, Vec3 centre,
                                          double radius_m, std::vector<std::optional<Blob>>& chosen) const;
    void assign_roles(const RayIntersection& found,
                      const std::vector<const kernels::Silhouettes*>& silhouettes,
                      const std::vector<std::optional<Blob>>& chosen, std::vector<CameraRole>& roles) const;
    void place_lattice(const std::vector<std::optional<Blob>>& chosen, TrackerUpdate& update);
    void handle_miss(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update);
    void report_cameras(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update);

    std::vector<Camera> cameras_;
    double fps_;
    TrackerOptions options_;
    std::vector<CameraState> camera_states_;
    CentreFilter filter_;
    bool tracking_ = false;
    std::optional<std::int64_t> first_seen_ns_;  // of a subject that is not confirmed yet
    std::uint32_t subject_id_ = 0, last_id_ = 0;
    std::int64_t last_time_ns_ = 0;  // of the filter's state
    std::int64_t last_measured_ns_ = 0;
    std::uint64_t predictions_ = 0;
    double seconds_ahead_ = 0;    // of the last predict()
    Vec3 intersection_in_world_;  // of the rays in the last update, without the offset
    Vec3 shape_offset_;           // from there to the body's centre, m
    Box3 extent_;                 // of the subject, from its centre, m
    bool legs_missing_ = false;   // from the last volume: jumping, or they look like the floor
};

}  // namespace kinevox
