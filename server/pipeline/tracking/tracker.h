// Follows the subject's 3-D boundary from frame set to frame set: finds it in the silhouettes, keeps its
// centre in a Kalman filter, says where each camera should look next and which lattice the hull is to fill.
//
// Order of calls for each frame set: predict(), segmentation with its regions, update(), and observe_volume()
// where a volume was carved.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/tracking/blobs.h"
#include "server/pipeline/tracking/centre_filter.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pipeline/tracking/ray_meeting.h"

namespace kinevox {

struct TrackerOptions {
    double voxel_m = 0.01;
    double margin_m = 0.03;             // of the lattice around the cones' intersection
    double max_lattice_side_m = 2.5;    // a longer lattice is cut around the subject; arms spread are 1.9 m
    double limb_speed_m_s = 4;          // by how much the searched region outruns the centre's prediction
    double region_margin_m = 0.12;      // of the searched region, besides
    double full_pass_interval_s = 0.5;  // each camera's whole picture is searched so often
    double lost_after_s = 0.5;          // without a measurement
    double sure_score = 1.6;            // a meeting of this score is a subject at once,
    int unsure_frames = 3;              // a weaker one after so many frame sets in a row
    double min_score = 0.7;             // below this it is nothing
    int report_after_frames = 5;  // a camera that disagrees (or agrees again) so long in a row is reported
    // Silhouettes know nothing of depth: their rays meet beside the centre of a body that is long towards a
    // camera (a sprinter on the blocks: 8 cm). The last volumes' centres tell by how much; this part of the
    // difference enters with each frame set (0: never), no more than `max_shape_offset_m` altogether.
    double shape_offset_gain = 0.2;
    double max_shape_offset_m = 0.15;
    MeetingOptions meeting;
    CentreFilterOptions filter;

    // Empty when usable, else one sentence.
    std::string check() const;
};

// What a camera contributes to the frame set's result.
enum class CameraRole {
    kAgrees,     // its ray counts for G and its silhouette carves
    kPartial,    // its picture's border cuts the subject: carves, counts little for G
    kCannotSee,  // the subject is outside its picture: neither
    kLeftOut,    // should see the subject, but its silhouette disagrees: neither
    kSilent,     // no picture: neither
};

struct TrackerUpdate {
    std::optional<SubjectTrack> subject;      // empty while nobody is tracked
    std::optional<kernels::Lattice> lattice;  // empty while there is no measurement to carve
    std::vector<CameraRole> roles;            // per camera; kCannotSee while nobody is tracked
    std::vector<Event> events;
};

// Not thread safe.
class Tracker {
  public:
    Tracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options = {});

    // What the segmentation of each camera may count on at this time; `expected` is left null, and `reach_px`
    // is from the subject's own outline. `motion`, if given, is how far the subject is expected to have moved
    // since the last update, m.
    std::vector<kernels::SegmentationPrior> predict(std::int64_t time_ns, Vec3* motion = nullptr);

    // One entry a camera; null for a camera without a picture. `time_ns` as given to predict().
    TrackerUpdate update(std::uint64_t sequence, std::int64_t time_ns,
                         const std::vector<const kernels::Silhouettes*>& silhouettes);

    // The centre of gravity of the volume carved from the last update's lattice.
    void observe_volume(Vec3 centre_in_world);

    bool tracking() const { return tracking_; }
    // Forgets the subject, without an event.
    void reset();

  private:
    struct CameraState {
        bool silent = false, left_out = false;  // as reported
        int disagreeing = 0, agreeing = 0;      // frame sets in a row
    };
    using BlobsByCamera = std::vector<std::vector<Blob>>;

    std::int64_t min_pixels(const Camera& camera) const;
    double search_margin_m(double seconds) const;
    Box3 search_box(double seconds) const;
    RayCandidate candidate(int camera, const Blob& blob) const;
    std::optional<Meeting> find_meeting(const BlobsByCamera& blobs,
                                        std::vector<std::optional<Blob>>& chosen) const;
    std::optional<Meeting> gather(const BlobsByCamera& blobs, const Box3& around, Vec3 centre,
                                  double radius_m, std::vector<std::optional<Blob>>& chosen) const;
    void assign_roles(const Meeting& meeting, const std::vector<const kernels::Silhouettes*>& silhouettes,
                      const std::vector<std::optional<Blob>>& chosen, std::vector<CameraRole>& roles) const;
    void lay_lattice(const std::vector<std::optional<Blob>>& chosen, TrackerUpdate& update);
    void miss(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update);
    void report_cameras(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update);

    std::vector<Camera> cameras_;
    double fps_;
    TrackerOptions options_;
    std::vector<CameraState> camera_states_;
    CentreFilter filter_;
    bool tracking_ = false;
    int frames_seen_ = 0;  // in a row, while an unsure subject is not yet tracked
    std::uint32_t subject_id_ = 0;
    std::int64_t last_time_ns_ = 0;  // of the filter's state
    std::int64_t last_measured_ns_ = 0;
    std::uint64_t predictions_ = 0;
    double seconds_ahead_ = 0;  // of the last predict()
    Vec3 met_in_world_;         // where the rays met in the last update, without the offset
    Vec3 shape_offset_;         // from there to the body's centre, m
    Box3 extent_;               // of the subject, from its centre, m
};

}  // namespace kinevox
