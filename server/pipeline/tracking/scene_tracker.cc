#include "server/pipeline/tracking/scene_tracker.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "kernels/projection.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/subject_control.h"
#include "server/pipeline/tracking/scene_lattice.h"
#include "server/silhouettes/mask_box.h"
#include "server/silhouettes/to_kernel.h"

namespace kinevox {
namespace {

constexpr double kMaxGrowth_m = 0.5;  // of a subject's shape from one frame set to the next
constexpr double kBeside_m = 0.2;     // between a subject's largest part and its others, horizontally

constexpr double kMinPerson_litres = 20, kMaxPerson_litres = 1000;
constexpr double kMinUprightTop_m = 1.0;
constexpr double kMinLyingLength_m = 0.7;
constexpr double kMinSubject_litres = 8;
constexpr double kMaxPassInterval_s = 0.15;  // of whole images, so that a newcomer is found soon
constexpr std::size_t kMaxPeople = 32;       // tracked, followed or not
constexpr double kCentreStd_m = 0.03;
constexpr double kUsualGain = 0.1;  // of a frame set on the usual volume

bool is_beside(Vec3 at, const CellStatistics& body) {
    return at.x > body.min_in_world.x - kBeside_m && at.x < body.max_in_world.x + kBeside_m &&
           at.y > body.min_in_world.y - kBeside_m && at.y < body.max_in_world.y + kBeside_m;
}

// Of a centre that the hull shows.
Mat3 centre_covariance() {
    Mat3 covariance;
    for (double& each : covariance.m) each *= kCentreStd_m * kCentreStd_m;
    return covariance;
}

kernels::HullOptions hull_options(std::size_t cameras) {
    kernels::HullOptions options;
    options.min_views = cameras >= kernels::kManyCameras ? kernels::kMinViewsOfMany : 2;
    options.fill_radius_m = 0;
    return options;
}

}  // namespace

SceneTracker::SceneTracker(std::vector<Camera> cameras, double fps, const TrackerOptions& options,
                           SubjectControl* control)
    : cameras_(std::move(cameras)),
      fps_(fps),
      options_(options),
      control_(control),
      carver_(kernels::make_hull_carver(kernels::Device::kCpu, hull_options(cameras_.size()))),
      grid_(scene_lattice(cameras_)) {
    for (const Camera& camera : cameras_) models_.push_back(to_kernel(camera));
}

void SceneTracker::reset() {
    begin(last_id_);
    pending_.clear();
    memory_.forget();
    if (control_) control_->forget();
}

void SceneTracker::begin(std::uint32_t last_id) {
    subjects_.clear();
    beside_.clear();
    last_id_ = std::max(last_id_, last_id);
    predictions_ = 0;
}

// The shape with which a subject begins.
void SceneTracker::begin_with(Subject& subject, Cells cells, std::int64_t time_ns) const {
    subject.shape = grid_.statistics(cells);
    subject.cells = std::move(cells);
    subject.usual_litres = subject.shape.litres;
    subject.usual_centre = subject.shape.centre_in_world;
    subject.last_seen_ns = time_ns;
    subject.seen = true;
}

void SceneTracker::take_over(const TrackedState& taken, const kernels::VoxelVolume& shape) {
    Subject subject;
    subject.id = taken.id;
    subject.label = 1;
    subject.filter = taken.filter;
    begin_with(subject, grid_.cells_of(shape), taken.last_measured_ns);
    subject.followed = Followed::kYes;
    subject.followed_before = true;
    subjects_.push_back(std::move(subject));
    last_time_ns_ = taken.time_ns;
}

std::optional<TrackedState> SceneTracker::only_subject() const {
    if (subjects_.size() != 1) return std::nullopt;
    const Subject& subject = subjects_.front();
    if (!subject.seen || subject.followed != Followed::kYes) return std::nullopt;
    return TrackedState{subject.id,
                        subject.filter,
                        {subject.shape.min_in_world, subject.shape.max_in_world},
                        last_time_ns_,
                        subject.last_seen_ns};
}

Vec3 SceneTracker::motion(std::uint32_t subject_id) const {
    for (const Subject& subject : subjects_)
        if (subject.id == subject_id) return subject.motion;
    return {};
}

std::vector<kernels::SegmentationPrior> SceneTracker::predict(std::int64_t time_ns) {
    double seconds = 1e-9 * static_cast<double>(time_ns - last_time_ns_);
    if (!(seconds > 0 && seconds < 1)) seconds = 1 / fps_;  // after a clock step
    last_time_ns_ = time_ns;
    for (Subject& subject : subjects_) {
        const Vec3 before = subject.filter.centre_in_world();
        subject.filter.predict(seconds);
        subject.motion = subject.filter.centre_in_world() - before;
    }
    const auto interval = static_cast<std::uint64_t>(
        std::max(1.0, std::round(std::min(options_.full_pass_interval_s, kMaxPassInterval_s) * fps_)));
    // All cameras at once, unlike for one subject: a new subject must show in all of them.
    whole_images_ = subjects_.empty() || !pending_.empty() || predictions_ % interval == 0;
    ++predictions_;
    std::vector<kernels::SegmentationPrior> priors(cameras_.size());
    if (whole_images_) {
        // With a region, the background model does not learn the subjects.
        if (!subjects_.empty())
            for (std::size_t c = 0; c < cameras_.size(); ++c)
                priors[c].region = {0, 0, cameras_[c].width, cameras_[c].height};
        return priors;
    }
    const double margin = options_.region_margin_m + options_.limb_speed_m_per_s * seconds;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        kernels::Rect region;
        int max_distance_px = 0;
        for (const Subject& subject : subjects_) {
            const Box3 body{subject.shape.min_in_world + subject.motion,
                            subject.shape.max_in_world + subject.motion};
            const Vec3 wide{margin, margin, margin};
            const kernels::Rect one =
                projected_box(cameras_[c], {body.min_in_world - wide, body.max_in_world + wide});
            if (one.empty()) continue;
            region = region.empty() ? one : union_of(region, one);
            const double depth = nearest_depth(cameras_[c], body);
            if (depth <= kMinPartDistance_m || subject.shape.min_in_world.z > kMaxFeetHeight_m)
                max_distance_px = -1;  // legs that are missing may be apart
            else if (max_distance_px >= 0)
                max_distance_px = std::max(
                    max_distance_px,
                    static_cast<int>(std::ceil(std::max(cameras_[c].fx, cameras_[c].fy) * margin / depth)));
        }
        priors[c].max_distance_px = max_distance_px;
        priors[c].full_pass = false;
        priors[c].region = region.empty() ? kernels::Rect{0, 0, 8, 8} : region;  // nearly nothing to search
    }
    return priors;
}

void SceneTracker::look_at(const SilhouettesByCamera& silhouettes,
                           std::span<const kernels::ImageView> images) {
    views_.clear();
    for (std::size_t c = 0; c < images.size(); ++c)
        views_.push_back({&cameras_[c], images[c], silhouettes[c]});
}

// Between whole images only around the subjects, where the segmentation searched.
void SceneTracker::carve(const SilhouettesByCamera& silhouettes) {
    grid_.clear();
    if (whole_images_) return carve_in(grid_.lattice(), silhouettes);
    const double margin = options_.region_margin_m + kMaxGrowth_m;
    const Vec3 wide{margin, margin, margin};
    for (const Subject& subject : subjects_) {
        Vec3 low = subject.shape.min_in_world + subject.motion - wide;
        low.z = std::min(low.z, kSceneFloor_m);  // its legs may have been missing
        const kernels::Lattice part =
            grid_.part_over({low, subject.shape.max_in_world + subject.motion + wide});
        carve_in(part, silhouettes);
    }
}

void SceneTracker::carve_in(const kernels::Lattice& lattice, const SilhouettesByCamera& silhouettes) {
    if (std::ranges::any_of(lattice.size, [](int n) { return n == 0; })) return;
    const Box3 box = box_of(lattice);
    std::vector<kernels::HullView> views;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!silhouettes[c]) continue;
        const kernels::Rect& bounds = silhouettes[c]->bounds;
        views.push_back({&models_[c], silhouettes[c]->loose.data(),
                         whole_images_ ? bounds : cropped_to(bounds, cameras_[c], box)});
    }
    carver_->carve(views, lattice, hull_);
    grid_.add(hull_);
}

// Gives each subject the cells of its last shape, moved as expected, and what is connected with them.
void SceneTracker::claim() {
    const auto cells = [&](double m) { return static_cast<int>(std::lround(m / grid_.cell_m())); };
    for (const Subject& s : subjects_)
        grid_.give(s.cells, {cells(s.motion.x), cells(s.motion.y), cells(s.motion.z)}, s.label);
    for (const Cells& each : beside_) grid_.give(each, {0, 0, 0}, kNewcomersLabel);
    grid_.flood(cells(kMaxGrowth_m));
    keep_newcomers();
    std::vector<std::vector<Cells>> parts_of;
    for (const Subject& subject : subjects_) parts_of.push_back(grid_.parts(subject.label));
    return_limbs(grid_, parts_of);
    for (std::size_t n = 0; n < subjects_.size(); ++n) {
        Subject& subject = subjects_[n];
        std::vector<Cells>& parts = parts_of[n];
        subject.seen = false;
        if (parts.empty()) continue;
        join_halves(grid_, parts);
        // Two people that were found as one have parted: the part nearest to the expected centre stays.
        const Vec3 expected = subject.filter.centre_in_world();
        std::size_t main = 0;
        double distance = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < parts.size(); ++k) {
            if (k > 0 && !is_upright(parts[k])) continue;
            const double d = norm(grid_.statistics(parts[k]).centre_in_world - expected);
            if (d < distance) distance = d, main = k;
        }
        const CellStatistics body = grid_.statistics(parts[main]);
        Cells own = std::move(parts[main]);
        for (std::size_t k = 0; k < parts.size(); ++k) {
            if (k == main) continue;
            if (is_beside(grid_.statistics(parts[k]).centre_in_world, body) && !is_upright(parts[k]))
                own.insert(own.end(), parts[k].begin(), parts[k].end());
            else
                grid_.free(parts[k]);
        }
        CellStatistics shape = grid_.statistics(own);
        if (shape.litres > kMaxGrowthRatio * subject.usual_litres) {
            own = without_newcomers(subject, std::move(own));
            shape = grid_.statistics(own);
        }
        if (shape.litres < kMinSubject_litres || shape.litres > kMaxPerson_litres) {
            grid_.free(own);
            continue;
        }
        subject.cells = std::move(own);
        subject.shape = shape;
        subject.seen = true;
        if (shape.litres <= kMaxGrowthRatio * subject.usual_litres)
            subject.usual_centre = shape.centre_in_world;
        subject.usual_litres += kUsualGain * (shape.litres - subject.usual_litres);
    }
}

// Gives small parts beside or below a subject to it: a shank that a gap in the silhouettes separates.
void SceneTracker::adopt_small_parts() {
    for (const Cells& part : grid_.parts(OccupiedCells::kFree)) {
        const CellStatistics small = grid_.statistics(part);
        if (small.litres >= kMinPerson_litres) continue;
        Subject* nearest = nullptr;
        double distance = std::numeric_limits<double>::infinity();
        for (Subject& subject : subjects_) {
            if (!subject.seen || !is_beside(small.centre_in_world, subject.shape)) continue;
            const Vec3 offset = small.centre_in_world - subject.shape.centre_in_world;
            if (const double d = std::hypot(offset.x, offset.y); d < distance)
                distance = d, nearest = &subject;
        }
        if (!nearest) continue;
        grid_.give(part, {0, 0, 0}, nearest->label);
        nearest->cells.insert(nearest->cells.end(), part.begin(), part.end());
        nearest->shape = grid_.statistics(nearest->cells);
    }
}

// Whether a part has the size of a person who stands or walks.
bool SceneTracker::is_upright(const CellStatistics& s) {
    return s.litres >= kMinPerson_litres && s.max_in_world.z >= kMinUprightTop_m &&
           (s.min_in_world.z <= kMaxUprightBottom_m || lacks_legs(s));
}

// Who enters is upright; the first subject may lie or crouch from the start.
bool SceneTracker::may_start(const Cells& part) const {
    const CellStatistics s = grid_.statistics(part);
    if (s.litres > kMaxPerson_litres) return false;
    if (is_upright(s)) return true;
    const Vec3 extent = s.max_in_world - s.min_in_world;
    return subjects_.empty() && s.litres >= kMinPerson_litres &&
           std::max({extent.x, extent.y, extent.z}) >= kMinLyingLength_m;
}

Event SceneTracker::event(EventKind kind, const std::string& what, const Subject& subject,
                          std::uint64_t sequence, std::int64_t time_ns) {
    const Vec3 at = subject.shape.centre_in_world;
    return {kind,
            sequence,
            time_ns,
            {},
            fmt::format("subject {} {} ({:.2f}, {:.2f}, {:.2f}) m", subject.id, what, at.x, at.y, at.z),
            subject.id};
}

void SceneTracker::start(const Cells& cells, const std::optional<Recognition>& known, std::int64_t time_ns) {
    Subject subject;
    subject.id = known ? known->subject_id : ++last_id_;
    // Not lost yet, or strayed.
    if (known)
        std::erase_if(subjects_, [&](const Subject& other) {
            if (other.id != subject.id) return false;
            if (other.seen) grid_.free(other.cells);
            return true;
        });
    for (subject.label = 1;
         std::ranges::any_of(subjects_, [&](const Subject& other) { return other.label == subject.label; });)
        ++subject.label;
    begin_with(subject, cells, time_ns);
    subject.filter = CentreFilter(options_.filter);
    subject.filter.start(subject.shape.centre_in_world, centre_covariance());
    grid_.give(cells, {0, 0, 0}, subject.label);
    subject.found_as =
        known ? fmt::format("recognised ({:.0f} % sure)", std::floor(100 * known->probability)) : "found";
    subjects_.insert(std::ranges::upper_bound(subjects_, subject.id, {}, &Subject::id), std::move(subject));
}

void SceneTracker::find_new(std::int64_t time_ns, const SilhouettesByCamera& silhouettes) {
    still_pending_.clear();
    const bool first = subjects_.empty();
    std::vector<Cells> people;
    std::vector<Cells> parts = grid_.parts(OccupiedCells::kFree);
    join_halves(grid_, parts);
    for (const Cells& part : parts) {
        if (!may_start(part)) continue;
        for (Cells& share : split_by_trunks(grid_, part))
            if (may_start(share)) people.push_back(std::move(share));
    }
    if (!people.empty()) {
        // The first gets the lowest id, and is followed first: rather a person than a chair.
        std::ranges::stable_sort(people, std::ranges::greater{}, [&](const Cells& part) {
            return std::pair(grid_.statistics(part).max_in_world.z >= kTallPerson_m, part.size());
        });
        std::vector<kernels::VoxelVolume> known;
        for (const Subject& subject : subjects_) known.push_back(grid_.volume_of(subject.cells));
        std::vector<std::vector<std::uint8_t>> explained(cameras_.size());
        for_each_camera(cameras_.size(), [&](std::size_t c) {
            explained[c].assign(static_cast<std::size_t>(cameras_[c].width) * cameras_[c].height, 0);
            std::vector<std::uint8_t> mask(explained[c].size());
            const float still[3] = {0, 0, 0};
            kernels::Rect box;
            for (const kernels::VoxelVolume& volume : known) {
                kernels::project_volume(volume, models_[c], still, 1, mask.data(), box);
                add_box(mask, cameras_[c].width, box, explained[c]);
            }
        });
        for (const Cells& person : people) {
            if (subjects_.size() >= kMaxPeople) break;
            const Need need = need_of(person, silhouettes, explained);
            if (need == Need::kNone) continue;
            const Pending newcomer = continued(person, time_ns);
            std::optional<Recognition> known;
            if (decide(newcomer, first && need == Need::kManyViews, time_ns, known))
                start(person, known, time_ns);
            else {
                still_pending_.push_back(newcomer);
                keep_beside(person);
            }
        }
    }
    std::swap(pending_, still_pending_);
}

void SceneTracker::measure(std::int64_t time_ns) {
    for (Subject& subject : subjects_) {
        if (!subject.seen || subject.last_seen_ns == time_ns) continue;
        subject.filter.correct(subject.shape.centre_in_world, centre_covariance());
        subject.last_seen_ns = time_ns;
    }
}

void SceneTracker::drop_lost(std::uint64_t sequence, std::int64_t time_ns, SceneUpdate& update) {
    std::erase_if(subjects_, [&](const Subject& subject) {
        if (1e-9 * static_cast<double>(time_ns - subject.last_seen_ns) <= options_.lost_after_s) return false;
        if (subject.followed == Followed::kYes)
            update.events.push_back(event(EventKind::kSubjectLost, "lost near", subject, sequence, time_ns));
        return true;
    });
}

std::vector<CameraRole> SceneTracker::roles_of(const Subject& subject,
                                               const SilhouettesByCamera& silhouettes) const {
    std::vector<CameraRole> roles(cameras_.size(), CameraRole::kInlier);
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (!silhouettes[c]) {
            roles[c] = CameraRole::kNoImage;
            continue;
        }
        const double inside = grid_.fraction_in_view(subject.cells, cameras_[c]);
        if (inside < kMinExpectedInside)
            roles[c] = CameraRole::kOutOfView;
        else if (inside < 1)
            roles[c] = CameraRole::kTruncated;
    }
    return roles;
}

SceneSubject SceneTracker::described(const Subject& subject, const SilhouettesByCamera& silhouettes) const {
    SceneSubject out;
    out.roles = roles_of(subject, silhouettes);
    out.track.subject_id = subject.id;
    if (control_) out.track.name = control_->name_of(subject.id);
    out.track.centre_in_world =
        subject.seen ? subject.shape.centre_in_world : subject.filter.centre_in_world();
    out.track.velocity_in_world = subject.filter.velocity_in_world();
    out.track.centre_std_m = subject.filter.centre_std_m();
    for (const CameraRole role : out.roles)
        out.track.used_cameras.push_back(subject.seen &&
                                         (role == CameraRole::kInlier || role == CameraRole::kTruncated));
    if (!subject.seen) return out;
    const double margin = options_.margin_m + grid_.cell_m();
    const Vec3 wide{margin, margin, margin};
    Vec3 low = subject.shape.min_in_world;
    if (low.z > kMaxFeetHeight_m) low.z = 0;  // legs that look like the floor are searched for
    out.lattice = lattice_over({low - wide, subject.shape.max_in_world + wide}, options_.voxel_m,
                               options_.max_lattice_side_m, subject.shape.centre_in_world);
    return out;
}

SceneUpdate SceneTracker::update(std::uint64_t sequence, std::int64_t time_ns,
                                 const SilhouettesByCamera& silhouettes,
                                 std::span<const kernels::ImageView> images) {
    SceneUpdate update;
    look_at(silhouettes, images);
    carve(silhouettes);
    claim();
    measure(time_ns);
    if (whole_images_) find_new(time_ns, silhouettes);
    drop_lost(sequence, time_ns, update);
    adopt_small_parts();
    remember(time_ns);
    follow(sequence, time_ns, update);
    publish(time_ns);
    for (const Subject& subject : subjects_) {
        if (subject.followed == Followed::kYes)
            update.subjects.push_back(described(subject, silhouettes));
        else if (subject.seen)
            update.bystanders.push_back({subject.id, grid_.volume_of(subject.cells)});
    }
    std::erase_if(beside_, [&](const Cells& each) { return !grid_.is_free(each.front()); });
    for (const Cells& each : beside_) update.bystanders.push_back({0, grid_.volume_of(each)});
    return update;
}

void SceneTracker::restrict_to(std::uint32_t subject_id, kernels::VoxelVolume& volume) const {
    const auto subject = std::ranges::find(subjects_, subject_id, &Subject::id);
    if (subject == subjects_.end() || subjects_.size() == 1) return;
    grid_.keep(subject->label, volume);
}

}  // namespace kinevox
