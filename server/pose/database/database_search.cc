#include "server/pose/database/database_search.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace kinevox {
namespace {

using kernels::kHeadings;
using kernels::kViewBins;

constexpr double kTurn = 2 * std::numbers::pi;
// Area range of a person's silhouette, m^2 for a stature of 1.75 m: part of a limb, to more than spread arms
// and a coat.
constexpr double kMinArea = 0.03, kMaxArea = 1.6, kStature = 1.75;

// Index of the first minimum in [from, to), vectorised over eight lanes.
int min_index(const float* scores, int from, int to) {
    float lanes[8];
    std::fill_n(lanes, 8, scores[from]);
    int h = from;
    for (; h + 8 <= to; h += 8)
        for (int lane = 0; lane < 8; ++lane)
            lanes[lane] = scores[h + lane] < lanes[lane] ? scores[h + lane] : lanes[lane];
    float lowest = *std::min_element(lanes, lanes + 8);
    for (; h < to; ++h) lowest = std::min(lowest, scores[h]);
    for (h = from; h < to; ++h)
        if (scores[h] == lowest) return h;
    return from;
}

bool nearer(const FoundPose& a, const FoundPose& b) {
    if (a.distance != b.distance) return a.distance < b.distance;
    return a.pose != b.pose ? a.pose < b.pose : a.heading < b.heading;
}

}  // namespace

DatabaseSearch::DatabaseSearch(const PoseDatabase& database, const SearchOptions& options)
    : database_(database),
      options_(options),
      scale_(options.stature_m > 0 ? options.stature_m / database.shape.stature_m : 1.0),
      calculator_(kernels::make_moment_calculator(kernels::Device::kCpu, {.order = database.options.order})),
      moment_scale_(database.values()) {
    kernels::moment_orthonormal_scale(database.options.order, moment_scale_.data());
    if (options.rule != RetrievalRule::kPublished) return;
    for (const PoseDatabase::Slab& slab : database.slabs) {
        auto& sorted = by_first_moment_.emplace_back();
        for (int view = 0; view < database.pose_count() * kViewBins; ++view)
            sorted.emplace_back(
                database.moment_step * slab.moments[static_cast<std::size_t>(view) * database.values()],
                view);
        std::sort(sorted.begin(), sorted.end());
    }
}

SilhouetteUse DatabaseSearch::judge(const AimedSilhouette& silhouette) const {
    const double metres_per_px = 2 * database_.half_width_m() * scale_ / database_.options.side_px;
    const double area = silhouette.pixels * metres_per_px * metres_per_px;
    const double unit = std::pow(database_.shape.stature_m * scale_ / kStature, 2);
    if (area < kMinArea * unit) return SilhouetteUse::kEmpty;
    if (area > kMaxArea * unit) return SilhouetteUse::kTooLarge;
    return silhouette.truncated ? SilhouetteUse::kTruncated : SilhouetteUse::kUsed;
}

int DatabaseSearch::describe(std::span<const PoseView> views, Vec3 centre) {
    centre_ = centre;
    uses_.assign(views.size(), SilhouetteUse::kAbsent);
    seen_.clear();
    aimed_.resize(std::max(aimed_.size(), views.size()));
    if (database_.slabs.empty() || !std::isfinite(centre.x + centre.y + centre.z)) return 0;
    std::vector<kernels::MomentView> to_describe;
    for (std::size_t n = 0; n < views.size(); ++n) {
        const PoseView& view = views[n];
        if (!view.camera || !view.silhouettes || view.silhouettes->sharp.empty()) continue;
        const AimedView aimed = aimed_view(camera_centre(*view.camera), centre,
                                           database_.half_width_m() * scale_, database_.options.side_px);
        rectify_silhouette(*view.camera, view.silhouettes->sharp.data(), view.silhouettes->bounds, aimed,
                           aimed_[n]);
        uses_[n] = judge(aimed_[n]);
        if (uses_[n] != SilhouetteUse::kUsed) continue;
        Seen& seen = seen_.emplace_back();
        seen.view = aimed;
        seen.slab = database_.nearest_slab(aimed.elevation, aimed.distance_m / scale_);
        seen.first_bin = -aimed.azimuth * kViewBins / kTurn;
        to_describe.push_back({aimed_[n].mask.data(),
                               database_.options.side_px,
                               aimed_[n].bounds,
                               {},
                               0.5f * static_cast<float>(database_.options.side_px)});
    }
    calculator_->compute(to_describe, described_);
    for (std::size_t n = 0; n < seen_.size(); ++n) {
        Seen& seen = seen_[n];
        seen.moments = described_[n].values;
        for (std::size_t v = 0; v < seen.moments.size(); ++v) seen.moments[v] *= moment_scale_[v];
        database_.encode(seen.moments.data(), seen.code);
        const double middle = 0.5 * (database_.options.side_px - 1);
        seen.centre_right_m = (described_[n].mapping.centre_x_px - middle) * seen.view.metres_per_px;
        seen.centre_down_m = (described_[n].mapping.centre_y_px - middle) * seen.view.metres_per_px;
    }
    return static_cast<int>(seen_.size());
}

DatabaseSearch::Blend DatabaseSearch::bins(const Seen& seen, int heading) {
    double place =
        std::fmod(seen.first_bin + heading * static_cast<double>(kViewBins) / kHeadings, kViewBins);
    if (place < 0) place += kViewBins;
    const int a = static_cast<int>(place) % kViewBins;
    return {a, (a + 1) % kViewBins, static_cast<float>(place - std::floor(place))};
}

float DatabaseSearch::exact_distance(int pose, int heading) const {
    const int values = database_.values();
    float sum = 0;
    for (const Seen& seen : seen_) {
        const Blend at = bins(seen, heading);
        const std::int16_t* views =
            database_.slabs[seen.slab].moments.data() + static_cast<std::size_t>(pose) * kViewBins * values;
        sum += kernels::blended_distance(
            seen.moments.data(), views + static_cast<std::ptrdiff_t>(at.a) * values,
            views + static_cast<std::ptrdiff_t>(at.b) * values, database_.moment_step * (1 - at.weight),
            database_.moment_step * at.weight, values);
    }
    return std::sqrt(sum / static_cast<float>(seen_.size()));
}

void DatabaseSearch::score_all() {
    scores_.resize(static_cast<std::size_t>(database_.entry_count()));
    std::vector<kernels::MomentQuery> queries;
    for (const Seen& seen : seen_)
        queries.push_back({&database_.slabs[seen.slab].search, seen.code, seen.first_bin});
    kernels::score_headings(queries, scores_);
}

// Of each pose its best heading and the best one at least a right angle away, then the best of these.
std::vector<FoundPose> DatabaseSearch::best_by_codes(int count) {
    score_all();
    std::vector<FoundPose> found;
    found.reserve(2 * static_cast<std::size_t>(database_.pose_count()));
    for (int pose = 0; pose < database_.pose_count(); ++pose) {
        const float* scores = scores_.data() + static_cast<std::size_t>(pose) * kHeadings;
        const int best = min_index(scores, 0, kHeadings);
        // The opposite half circle, split where headings wrap.
        const int from = (best + kHeadings / 4) % kHeadings, to = from + kHeadings / 2;
        int other = min_index(scores, from, std::min(to, kHeadings));
        if (to > kHeadings) {
            const int wrapped = min_index(scores, 0, to - kHeadings);
            if (scores[wrapped] < scores[other]) other = wrapped;
        }
        found.push_back({pose, best, scores[best]});
        found.push_back({pose, other, scores[other]});
    }
    if (static_cast<int>(found.size()) > count) {
        std::nth_element(found.begin(), found.begin() + count, found.end(), nearer);
        found.resize(count);
    }
    return found;
}

std::vector<FoundPose> DatabaseSearch::nearest_by_first_moment() const {
    const Seen& first = seen_.front();
    const auto& sorted = by_first_moment_[first.slab];
    const auto nearest = std::lower_bound(sorted.begin(), sorted.end(), std::pair{first.moments[0], 0});
    const std::ptrdiff_t middle = nearest - sorted.begin(), half = options_.neighbourhood / 2;
    const std::ptrdiff_t count = static_cast<std::ptrdiff_t>(sorted.size());
    const std::ptrdiff_t begin = std::clamp<std::ptrdiff_t>(
        middle - half, 0, std::max<std::ptrdiff_t>(0, count - options_.neighbourhood));
    std::vector<FoundPose> found;
    for (std::ptrdiff_t n = begin; n < std::min<std::ptrdiff_t>(begin + options_.neighbourhood, count); ++n) {
        const int view = sorted[n].second;
        const double heading = (view % kViewBins - first.first_bin) * kHeadings / kViewBins;
        const long step = std::lround(heading) % kHeadings;
        found.push_back({view / kViewBins, static_cast<int>(step < 0 ? step + kHeadings : step), 0});
    }
    return found;
}

void DatabaseSearch::refine_heading(FoundPose& found) const {
    for (const int step : {1, kHeadings - 1}) {
        for (;;) {
            const int heading = (found.heading + step) % kHeadings;
            const double distance = exact_distance(found.pose, heading);
            if (!(distance < found.distance)) break;
            found.heading = heading, found.distance = distance;
        }
    }
}

std::vector<FoundPose> DatabaseSearch::find(int max_candidates) {
    if (seen_.empty() || max_candidates <= 0 || database_.poses.empty()) return {};
    std::vector<FoundPose> found;
    switch (options_.rule) {
        case RetrievalRule::kAll:
            found = best_by_codes(std::max(options_.reranked, max_candidates));
            break;
        case RetrievalRule::kPublished:
            found = nearest_by_first_moment();
            break;
        case RetrievalRule::kExhaustive:
            for (int pose = 0; pose < database_.pose_count(); ++pose)
                for (int heading = 0; heading < kHeadings; ++heading) found.push_back({pose, heading, 0});
    }
    for (FoundPose& one : found) one.distance = exact_distance(one.pose, one.heading);
    const std::size_t kept = std::min(found.size(), static_cast<std::size_t>(max_candidates));
    std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(kept), found.end(), nearer);
    found.resize(kept);
    if (options_.rule == RetrievalRule::kAll) {  // codes may be off by one heading
        for (FoundPose& one : found) refine_heading(one);
        std::sort(found.begin(), found.end(), nearer);
    }
    return found;
}

PoseCandidate DatabaseSearch::place(const FoundPose& found) const {
    PoseCandidate candidate;
    candidate.coordinates = database_.poses[found.pose].coordinates;
    candidate.distance = found.distance;
    const double heading = kTurn * found.heading / kHeadings;
    candidate.coordinates[kDofRootRotation + 2] = heading > std::numbers::pi ? heading - kTurn : heading;
    // The body's centre is the tracked centre plus `d`, such that each silhouette's centre matches: right . d
    // = observed - stored, down . d likewise, in least squares; undetermined directions stay.
    double a[9] = {1e-3, 0, 0, 0, 1e-3, 0, 0, 0, 1e-3};
    Vec3 b;
    for (const Seen& seen : seen_) {
        const Blend at = bins(seen, found.heading);
        const float* centres =
            database_.slabs[seen.slab].centres.data() + static_cast<std::size_t>(found.pose) * 2 * kViewBins;
        const double right = scale_ * ((1 - at.weight) * centres[2 * at.a] + at.weight * centres[2 * at.b]);
        const double down =
            scale_ * ((1 - at.weight) * centres[2 * at.a + 1] + at.weight * centres[2 * at.b + 1]);
        for (const auto& [axis, miss] : {std::pair{seen.view.right, seen.centre_right_m - right},
                                         std::pair{seen.view.down, seen.centre_down_m - down}}) {
            const double n[3] = {axis.x, axis.y, axis.z};
            for (int r = 0; r < 3; ++r)
                for (int c = 0; c < 3; ++c) a[3 * r + c] += n[r] * n[c];
            b += miss * axis;
        }
    }
    const Vec3 c0{a[0], a[3], a[6]}, c1{a[1], a[4], a[7]}, c2{a[2], a[5], a[8]};
    const double determinant = dot(c0, cross(c1, c2));  // Cramer; symmetric and positive
    const Vec3 d{dot(b, cross(c1, c2)) / determinant, dot(c0, cross(b, c2)) / determinant,
                 dot(c0, cross(c1, b)) / determinant};
    const Vec3 root = centre_ + d - rotation_z(heading) * (scale_ * database_.body_centres[found.pose]);
    candidate.coordinates[0] = root.x, candidate.coordinates[1] = root.y, candidate.coordinates[2] = root.z;
    return candidate;
}

std::vector<PoseCandidate> DatabaseSearch::propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                                   int max_candidates) {
    std::vector<PoseCandidate> candidates;
    if (describe(views, centre_in_world) == 0) return candidates;
    for (const FoundPose& found : find(max_candidates)) candidates.push_back(place(found));
    return candidates;
}

}  // namespace kinevox
