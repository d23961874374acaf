#include "server/pipeline/tracking/tracker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "server/pipeline/for_each_camera.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxBlobs = 6;      // per camera
constexpr double kMaxCentreJump_m = 0.4;  // of a measured centre from the predicted one
constexpr double kBodyRadius_m = 1.4;     // of a body around its centre

Box3 box_around(Vec3 centre, const Box3& extent, double margin_m) {
    const Vec3 margin{margin_m, margin_m, margin_m};
    return {centre + extent.min_in_world - margin, centre + extent.max_in_world + margin};
}

// A standing or stretched person of any size, from the centre of gravity.
constexpr Box3 kAnyPerson{{-kMaxStride_m, -kMaxStride_m, -1.15}, {kMaxStride_m, kMaxStride_m, 1.15}};

// A person stands on the floor. Legs that look like it are searched for down to it, within a stride to all
// sides.
Box3 down_to_floor(Box3 extent, Vec3 centre, bool legs_missing) {
    const double floor = std::max(-centre.z, kAnyPerson.min_in_world.z);
    if (!legs_missing && extent.min_in_world.z < floor + kMaxFeetHeight_m) return extent;
    Vec3 &low = extent.min_in_world, &high = extent.max_in_world;
    low = {std::min(low.x, kAnyPerson.min_in_world.x), std::min(low.y, kAnyPerson.min_in_world.y), floor};
    high = {std::max(high.x, kAnyPerson.max_in_world.x), std::max(high.y, kAnyPerson.max_in_world.y), high.z};
    return extent;
}

}  // namespace

std::string TrackerOptions::check() const {
    if (!(voxel_m >= 0.001 && voxel_m <= 0.2))
        return fmt::format("voxel_m is {} m; it must be between 0.001 and 0.2", voxel_m);
    if (!(max_lattice_side_m >= 0.5 && max_lattice_side_m <= 10))
        return fmt::format("max_lattice_side_m is {} m; it must be between 0.5 and 10", max_lattice_side_m);
    if (!(shape_offset_gain >= 0 && shape_offset_gain <= 1))
        return fmt::format("shape_offset_gain is {}; it must be between 0 and 1", shape_offset_gain);
    if (const std::string problem = rules.check(); !problem.empty()) return problem;
    if (!(lost_after_s > 0)) return fmt::format("lost_after_s is {} s; it must be positive", lost_after_s);
    return {};
}

Tracker::Tracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options)
    : cameras_(std::move(cameras)),
      fps_(fps),
      options_(options),
      camera_states_(cameras_.size()),
      filter_(options.filter) {}

void Tracker::reset() {
    tracking_ = false;
    first_seen_ns_.reset();
    for (CameraState& state : camera_states_) state = {};
}

std::optional<TrackedState> Tracker::subject() const {
    if (!tracking_) return std::nullopt;
    return TrackedState{subject_id_, filter_, box_around(filter_.centre_in_world(), extent_, 0),
                        last_time_ns_, last_measured_ns_};
}

void Tracker::take_over(const std::optional<TrackedState>& subject, std::uint32_t last_id) {
    reset();
    last_id_ = std::max(last_id_, last_id);
    if (!subject) return;
    tracking_ = true;
    subject_id_ = subject->id;
    filter_ = subject->filter;
    const Vec3 centre = filter_.centre_in_world();
    extent_ = down_to_floor(
        {subject->box_in_world.min_in_world - centre, subject->box_in_world.max_in_world - centre}, centre,
        false);
    last_time_ns_ = subject->time_ns;
    last_measured_ns_ = subject->last_measured_ns;
    predictions_ = 0;
    shape_offset_ = {};
    legs_missing_ = false;
}

// Smaller blobs are no person: a thin one of 1/20 of the image height.
std::int64_t Tracker::min_pixels(const Camera& camera) const {
    return std::max<std::int64_t>(16, std::int64_t{camera.height} * camera.height / 3000);
}

double Tracker::search_margin_m(double seconds) const {
    return options_.region_margin_m + options_.limb_speed_m_per_s * seconds + 2 * filter_.centre_std_m();
}

Box3 Tracker::search_box(double seconds) const {
    return box_around(filter_.centre_in_world(), extent_, search_margin_m(seconds));
}

std::vector<kernels::SegmentationPrior> Tracker::predict(std::int64_t time_ns, Vec3* motion) {
    std::vector<kernels::SegmentationPrior> priors(cameras_.size());
    if (motion) *motion = {};
    if (!tracking_) return priors;
    double seconds = 1e-9 * static_cast<double>(time_ns - last_time_ns_);
    if (!(seconds > 0 && seconds < 1)) seconds = 1 / fps_;  // after a clock step
    const Vec3 before = filter_.centre_in_world();
    filter_.predict(seconds);
    last_time_ns_ = time_ns;
    seconds_ahead_ = seconds;
    if (motion) *motion = filter_.centre_in_world() - before;

    const Box3 box = search_box(seconds);
    const double margin_m = search_margin_m(seconds);
    const auto interval =
        static_cast<std::uint64_t>(std::max(1.0, std::round(options_.full_pass_interval_s * fps_)));
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        // Staggered, so that the cost is spread over frame sets.
        priors[c].full_pass = (predictions_ + c * interval / cameras_.size()) % interval == 0;
        priors[c].region = projected_box(cameras_[c], box);
        // Of the subject's nearest point; without a bound where it may be behind the camera.
        const double depth = nearest_depth(cameras_[c], box_around(filter_.centre_in_world(), extent_, 0));
        // Its legs may be apart from what was found of it.
        if (depth > kMinPartDistance_m && !legs_missing_)
            priors[c].max_distance_px =
                static_cast<int>(std::ceil(std::max(cameras_[c].fx, cameras_[c].fy) * margin_m / depth));
        if (priors[c].region.empty())
            priors[c].region = {0, 0, 8, 8};  // out of view: nearly nothing to search
    }
    ++predictions_;
    return priors;
}

RayCandidate Tracker::candidate(int camera, const Blob& blob) const {
    const Camera& c = cameras_[camera];
    return {camera, c.ray_through({blob.centroid_x, blob.centroid_y}), static_cast<double>(blob.sharp_pixels),
            2 / (c.fx + c.fy), blob.at_border};
}

std::optional<RayIntersection> Tracker::find_intersection(const BlobsByCamera& blobs,
                                                          std::vector<std::optional<Blob>>& chosen) const {
    std::vector<RayCandidate> candidates;
    for (int c = 0; c < static_cast<int>(cameras_.size()); ++c)
        for (const Blob& blob : blobs[c]) candidates.push_back(candidate(c, blob));
    auto found = intersect_rays(candidates, static_cast<int>(cameras_.size()), options_.ray_intersection);
    if (!found) return std::nullopt;
    // A person may be several blobs: gather those around the intersection.
    const Box3 around = box_around(found->point_in_world, kAnyPerson, 0);
    return gather(blobs, around, found->point_in_world, kBodyRadius_m, chosen);
}

// Per camera the blobs in the projection of `around`: merged, or the best single one, whichever is more
// consistent.
std::optional<RayIntersection> Tracker::gather(const BlobsByCamera& blobs, const Box3& around, Vec3 centre,
                                               double radius_m,
                                               std::vector<std::optional<Blob>>& chosen) const {
    std::vector<RayCandidate> candidates;
    std::vector<Blob> of_candidate;
    for (int c = 0; c < static_cast<int>(cameras_.size()); ++c) {
        const kernels::Rect area = projected_box(cameras_[c], around);
        if (area.empty()) continue;
        std::vector<Blob> inside;
        for (const Blob& blob : blobs[c]) {
            const double x = blob.centroid_x, y = blob.centroid_y;
            if (x >= area.x0 && x < area.x1 && y >= area.y0 && y < area.y1 && overlap(blob.bounds, area))
                inside.push_back(blob);
        }
        if (inside.empty()) continue;
        std::vector<Blob> options = inside;
        if (inside.size() > 1) options.push_back(merged(inside));
        for (const Blob& blob : options) {
            of_candidate.push_back(blob);
            candidates.push_back(candidate(c, blob));
        }
    }
    const auto found = intersect_rays(candidates, static_cast<int>(cameras_.size()),
                                      options_.ray_intersection, &centre, radius_m);
    chosen.assign(cameras_.size(), std::nullopt);
    if (!found) return std::nullopt;
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        if (found->chosen[c] >= 0) chosen[c] = of_candidate[found->chosen[c]];
    return found;
}

void Tracker::assign_roles(const RayIntersection& found,
                           const std::vector<const kernels::Silhouettes*>& silhouettes,
                           const std::vector<std::optional<Blob>>& chosen,
                           std::vector<CameraRole>& roles) const {
    const Box3 body = box_around(found.point_in_world, tracking_ ? extent_ : kAnyPerson, 0);
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        double inside = 0;
        projected_box(cameras_[c], body, &inside);
        if (!silhouettes[c])
            roles[c] = CameraRole::kNoImage;
        else if (chosen[c])
            roles[c] = chosen[c]->at_border ? CameraRole::kTruncated : CameraRole::kInlier;
        else
            roles[c] = inside < kMinExpectedInside ? CameraRole::kOutOfView : CameraRole::kExcluded;
    }
}

void Tracker::place_lattice(const std::vector<std::optional<Blob>>& chosen, TrackerUpdate& update) {
    std::vector<SilhouetteCone> cones;
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        if (chosen[c]) cones.push_back({&cameras_[c], chosen[c]->bounds});
    const Vec3 centre = update.subject->centre_in_world;
    const Vec3 radius{kBodyRadius_m, kBodyRadius_m, kBodyRadius_m};
    const Box3 within{centre - radius, centre + radius};
    // Cones without an intersection belong to a partly visible subject; use the size of a person.
    Box3 box = box_of_cones(cones, within).value_or(box_around(centre, kAnyPerson, 0));
    extent_ = down_to_floor({box.min_in_world - centre, box.max_in_world - centre}, centre, legs_missing_);
    box = box_around(centre, extent_, 0);
    const Vec3 margin{options_.margin_m, options_.margin_m, options_.margin_m};
    box = {box.min_in_world - margin, box.max_in_world + margin};
    update.lattice = lattice_over(box, options_.voxel_m, options_.max_lattice_side_m, centre);
}

void Tracker::handle_miss(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update) {
    first_seen_ns_.reset();
    if (!tracking_) return;
    if (1e-9 * static_cast<double>(time_ns - last_measured_ns_) <= options_.lost_after_s) {
        update.subject = SubjectTrack{subject_id_, filter_.centre_in_world(), filter_.velocity_in_world(),
                                      filter_.centre_std_m(), std::vector<bool>(cameras_.size(), false)};
        return;
    }
    tracking_ = false;
    const Vec3 at = filter_.centre_in_world();
    update.events.push_back(
        {EventKind::kSubjectLost,
         sequence,
         time_ns,
         {},
         fmt::format("subject {} lost near ({:.2f}, {:.2f}, {:.2f}) m", subject_id_, at.x, at.y, at.z),
         subject_id_});
    for (CameraState& state : camera_states_) state.outlier_count = state.inlier_count = 0;
}

TrackerUpdate Tracker::update(std::uint64_t sequence, std::int64_t time_ns,
                              const std::vector<const kernels::Silhouettes*>& silhouettes,
                              const Newcomer& newcomer) {
    TrackerUpdate update;
    update.roles.assign(cameras_.size(), CameraRole::kOutOfView);
    BlobsByCamera blobs(cameras_.size());
    for_each_camera(cameras_.size(), [&](std::size_t c) {
        if (silhouettes[c])
            blobs[c] = find_blobs(*silhouettes[c], min_pixels(cameras_[c]), kMaxBlobs);
        else
            update.roles[c] = CameraRole::kNoImage;
    });

    std::vector<std::optional<Blob>> chosen(cameras_.size());
    std::optional<RayIntersection> found;
    if (tracking_)
        found = gather(blobs, search_box(seconds_ahead_), filter_.centre_in_world(),
                       kMaxCentreJump_m + 3 * filter_.centre_std_m(), chosen);
    else
        found = find_intersection(blobs, chosen);
    const bool seen = found && found->score >= options_.min_score;
    const std::int64_t first_seen_ns = std::min(first_seen_ns_.value_or(time_ns), time_ns);
    if (seen && !tracking_) first_seen_ns_ = first_seen_ns;
    const double seen_s = 1e-9 * static_cast<double>(time_ns - first_seen_ns);
    const double undecided_s = newcomer.undecided ? kMaxUndecided_s : 0;
    const bool certain = found && found->score >= options_.confirm_score && undecided_s == 0;
    if (!seen || (!tracking_ && !certain && seen_s < options_.confirm_s + undecided_s)) {
        if (!seen) handle_miss(sequence, time_ns, update);
        report_cameras(sequence, time_ns, update);
        return update;
    }

    if (!tracking_) shape_offset_ = {}, legs_missing_ = false;
    intersection_in_world_ = found->point_in_world;
    found->point_in_world += shape_offset_;
    assign_roles(*found, silhouettes, chosen, update.roles);
    if (!tracking_) {
        filter_.start(found->point_in_world, found->covariance_m2);
        tracking_ = true;
        predictions_ = 0;
        subject_id_ = newcomer.id ? newcomer.id : last_id_ + 1;
        last_id_ = std::max(last_id_, subject_id_);
        const Vec3 at = found->point_in_world;
        update.events.push_back(
            {EventKind::kSubjectFound,
             sequence,
             time_ns,
             {},
             fmt::format("subject {} {} at ({:.2f}, {:.2f}, {:.2f}) m by {} cameras", subject_id_,
                         newcomer.found_as, at.x, at.y, at.z, found->inlier_count),
             subject_id_});
    } else {
        filter_.correct(found->point_in_world, found->covariance_m2);
    }
    first_seen_ns_.reset();
    last_time_ns_ = last_measured_ns_ = time_ns;
    update.subject = SubjectTrack{
        subject_id_, found->point_in_world, filter_.velocity_in_world(), filter_.centre_std_m(), {}};
    for (const CameraRole role : update.roles)
        update.subject->used_cameras.push_back(role == CameraRole::kInlier || role == CameraRole::kTruncated);
    place_lattice(chosen, update);
    report_cameras(sequence, time_ns, update);
    return update;
}

void Tracker::observe_volume(Vec3 centre_in_world, bool legs_missing) {
    if (!tracking_) return;
    legs_missing_ = legs_missing;
    shape_offset_ += options_.shape_offset_gain * (centre_in_world - intersection_in_world_ - shape_offset_);
    const double length = norm(shape_offset_);
    if (length > options_.max_shape_offset_m)
        shape_offset_ = (options_.max_shape_offset_m / length) * shape_offset_;
}

void Tracker::report_cameras(std::uint64_t sequence, std::int64_t time_ns, TrackerUpdate& update) {
    const auto report = [&](EventKind kind, std::size_t c, std::string message) {
        update.events.push_back({kind, sequence, time_ns, cameras_[c].name, std::move(message)});
    };
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        CameraState& state = camera_states_[c];
        const std::string& name = cameras_[c].name;
        const bool no_image = update.roles[c] == CameraRole::kNoImage;
        if (no_image && !state.no_image)
            report(EventKind::kCameraNoImage, c, fmt::format("camera {} delivers no image", name));
        if (!no_image && state.no_image && !state.excluded)
            report(EventKind::kCameraResumed, c, fmt::format("camera {} delivers images again", name));
        state.no_image = no_image;
        if (!update.subject) continue;
        const bool inlier =
            update.roles[c] == CameraRole::kInlier || update.roles[c] == CameraRole::kTruncated;
        const bool outlier = update.roles[c] == CameraRole::kExcluded;
        state.inlier_count = inlier ? state.inlier_count + 1 : 0;
        state.outlier_count = outlier ? state.outlier_count + 1 : 0;
        if (!state.excluded && state.outlier_count == options_.report_after_frames) {
            state.excluded = true;
            report(
                EventKind::kCameraExcluded, c,
                fmt::format(
                    "camera {} is excluded: its silhouette is inconsistent with the other cameras; check its "
                    "calibration, background and view",
                    name));
        }
        if (state.excluded && state.inlier_count == options_.report_after_frames) {
            state.excluded = false;
            report(EventKind::kCameraIncluded, c,
                   fmt::format("camera {} is consistent with the others again", name));
        }
    }
}

}  // namespace kinevox
