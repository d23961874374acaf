#include "server/pose/limb_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace kinevox {
namespace {

constexpr int kDirections = 64;  // on the sphere; those outside a joint's range are skipped
constexpr int kTwists = 6;
constexpr double kBends[] = {0.2, 1.1, 2.0};  // of elbow and knee, rad
constexpr double kFineBends[] = {0.2, 0.7, 1.2, 1.7, 2.2};
constexpr int kFineTwists = 8;
constexpr std::size_t kRayStep = 3;  // stride: a subset of the rays suffices for the choice
constexpr double kStraight = 0.3;    // rad; below it the rotation of a straight limb has no effect
constexpr double kRaysGained = 1.5;  // minimum number of additionally explained rays of the subset
// A coarse configuration of a pair is compared with a fitted one, so it may be worse by this many rays before
// it is fitted.
constexpr double kPairSlack = 2;
// Of plausible(): the rays that it may explain less than the present configuration does, which was fitted.
constexpr double kPlausibleRays = 12;
constexpr std::size_t kMaxPlausible = 16;
constexpr std::array<double, 2> kBalls{0.2, 0.8};  // along each capsule, for what lies outside
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// Evenly over the sphere (a Fibonacci lattice).
Vec3 direction(int k) {
    const double z = 1 - (2 * k + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
    return {r * std::cos(turn), r * std::sin(turn), z};
}

bool reachable(const LimbSegments& limb, Vec3 u) {
    const double outwards = limb.left ? u.y : -u.y;
    if (limb.arm) return u.x > -0.75 && outwards > -0.6 && !(u.z > 0.3 && u.x < -0.5);
    return u.z < 0.45 && u.x > -0.6 && outwards > -0.4 && outwards < 0.85;
}

// Rotates the hanging limb to a direction along the shortest arc, after a twist about its own axis.
Mat3 towards(Vec3 u, double twist) {
    const Vec3 down{0, 0, -1};
    const Vec3 axis = cross(down, u);
    const double sine = norm(axis), angle = std::atan2(sine, dot(down, u));
    const Mat3 swing = sine < 1e-9 ? (angle < 1 ? Mat3{} : rotation_x(std::numbers::pi))
                                   : rotation_from_rodrigues((angle / sine) * axis);
    return swing * rotation_z(twist);
}

double kernel(double residual, double robust_m) {
    const double r2 = residual * residual;
    return r2 / (1 + r2 / (robust_m * robust_m));
}

void clear(ContourRays& rays, Vec3 origin_in_world) {
    rays.origin_in_world = origin_in_world;
    for (int axis = 0; axis < 3; ++axis) rays.direction[axis].clear(), rays.outward[axis].clear();
}

void append(const ContourRays& from, std::size_t ray, ContourRays& to) {
    for (int axis = 0; axis < 3; ++axis) {
        to.direction[axis].push_back(from.direction[axis][ray]);
        to.outward[axis].push_back(from.outward[axis][ray]);
    }
}

}  // namespace

LimbSegments segments_of(Limb limb) {
    switch (limb) {
        case Limb::kArmL:
            return {kUpperArmL, kForearmL, kHandL, true, true};
        case Limb::kArmR:
            return {kUpperArmR, kForearmR, kHandR, true, false};
        case Limb::kLegL:
            return {kThighL, kShankL, kFootL, false, true};
        case Limb::kLegR:
            break;
    }
    return {kThighR, kShankR, kFootR, false, false};
}

void append_capsules(const BodyModel& model, const Rigid3& world_from_parent, const LimbSegments& limb,
                     const LimbRotations& rotations, std::vector<BodyCapsule>& out) {
    Vec3 origin = model.offset_in_parent(limb.upper);
    if (limb.arm) origin += model.shoulder_shift(limb.left, rotations.upper * Vec3{0, 0, -1});
    const Rigid3 upper = world_from_parent * Rigid3{rotations.upper, origin};
    const Rigid3 lower = upper * Rigid3{rotations.lower, model.offset_in_parent(limb.lower)};
    const Rigid3 end = lower * Rigid3{rotations.end, model.offset_in_parent(limb.end)};
    for (const BodyCapsule& capsule : model.capsules_in_segments()) {
        const int s = capsule.segment;
        if (limb.has(s))
            out.push_back(capsule_in_world(s == limb.upper ? upper : s == limb.lower ? lower : end, capsule));
    }
}

void LimbSearch::thin_out(std::span<const SilhouetteRays> views) {
    thinned_.resize(views.size());
    for (std::size_t c = 0; c < views.size(); ++c) {
        const ContourRays& all = views[c].contour;
        ContourRays& some = thinned_[c].rays;
        clear(some, all.origin_in_world);
        for (std::size_t i = 0; views[c].camera && i < all.size(); i += kRayStep) append(all, i, some);
    }
}

// Of each body of `per_body` capsules, the part of the cost that lies outside the silhouettes.
void LimbSearch::measure_outside(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules,
                                 std::size_t per_body, double robust_m) {
    balls_.place(capsules, kBalls);
    outside_cost_.assign(capsules.size() / per_body, 0);
    for (const SilhouetteRays& view : views) {
        if (!view.camera) continue;
        balls_.measure(view);
        for (std::size_t k = 0; k < balls_.size(); ++k)
            if (const double outside_m = balls_.outside_m(k); outside_m > 0)
                outside_cost_[k / (per_body * kBalls.size())] += kernel(outside_m, robust_m);
    }
}

// Incomplete, but at least `limit`, where it exceeds that.
double LimbSearch::contour_cost(std::span<const RaySubset> subsets, std::span<const BodyCapsule> capsules,
                                double robust_m, double limit) {
    double sum = 0;
    for (const RaySubset& subset : subsets) {
        nearest_capsules(subset.rays, capsules, distance_, which_);
        for (std::size_t i = 0; i < distance_.size(); ++i)
            sum += kernel(std::min(distance_[i], subset.rest_distance[i]), robust_m);
        if (sum >= limit) break;
    }
    return sum;
}

// Copies to reached_ the rays that a placed limb can be nearer to than the rest of the body is. Returns the
// cost of the others.
double LimbSearch::keep_reached(Vec3 joint_in_world, double robust_m) {
    double max_distance_m = 0;
    for (const BodyCapsule& c : placed_)
        max_distance_m =
            std::max({max_distance_m, norm(Vec3{c.a[0], c.a[1], c.a[2]} - joint_in_world) + c.radius_a,
                      norm(Vec3{c.b[0], c.b[1], c.b[2]} - joint_in_world) + c.radius_b});
    double rest_cost = 0;
    reached_.resize(thinned_.size());
    for (std::size_t c = 0; c < thinned_.size(); ++c) {
        const RaySubset& all = thinned_[c];
        RaySubset& some = reached_[c];
        clear(some.rays, all.rays.origin_in_world);
        some.rest_distance.clear();
        const Vec3 to_joint = joint_in_world - all.rays.origin_in_world;
        for (std::size_t i = 0; i < all.rays.size(); ++i) {
            const auto& d = all.rays.direction;
            if (all.rest_distance[i] <=
                norm(cross(to_joint, Vec3{d[0][i], d[1][i], d[2][i]})) - max_distance_m) {
                rest_cost += kernel(all.rest_distance[i], robust_m);
                continue;
            }
            append(all.rays, i, some.rays);
            some.rest_distance.push_back(all.rest_distance[i]);
        }
    }
    return rest_cost;
}

double LimbSearch::cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules,
                        double robust_m) {
    measure_outside(views, capsules, capsules.size(), robust_m);
    return outside_cost_.front() + contour_cost(thinned_, capsules, robust_m, kUnlimited);
}

// Writes the capsules of the limbs in a posture to capsules_ and, if not null, all others to `others`.
void LimbSearch::split(const BodyModel& model, const BodyPosture& posture, std::span<const Limb> limbs,
                       std::vector<BodyCapsule>* others) {
    const auto belongs = [&](const BodyCapsule& c) {
        return std::ranges::any_of(limbs, [&](Limb limb) { return segments_of(limb).has(c.segment); });
    };
    model.capsules(model.forward(posture), capsules_);
    if (others) {
        others->clear();
        std::copy_if(capsules_.begin(), capsules_.end(), std::back_inserter(*others),
                     [&](const BodyCapsule& c) { return !belongs(c); });
    }
    std::erase_if(capsules_, [&](const BodyCapsule& c) { return !belongs(c); });
}

void LimbSearch::set_rest(std::span<const BodyCapsule> rest) {
    for (RaySubset& subset : thinned_) nearest_capsules(subset.rays, rest, subset.rest_distance, which_);
}

// Takes the limbs off the body. Returns the cost with them.
double LimbSearch::begin(const BodyModel& model, const BodyPosture& posture,
                         std::span<const SilhouetteRays> views, std::span<const Limb> limbs,
                         double robust_m) {
    std::vector<BodyCapsule> rest;
    split(model, posture, limbs, &rest);
    thin_out(views);
    set_rest(rest);
    return cost(views, capsules_, robust_m);
}

void LimbSearch::list_configurations(const BodyPosture& posture, const LimbSegments& limb,
                                     LimbSearchScope scope) {
    configurations_.clear();
    const auto add_twists = [&](Vec3 u, double bend, int twists, int of) {
        const Mat3 lower = rotation_from_rodrigues(bend * hinge_axis(limb.lower));
        for (int t = 0; t < twists; ++t) {
            const double twist = 2 * std::numbers::pi * (limb.arm ? t : t - (twists - 1) / 2.0) / of;
            configurations_.push_back({towards(u, twist), lower});
        }
    };
    if (scope == LimbSearchScope::kLower) {
        const Vec3 u = posture.parent_from_segment[limb.upper] * Vec3{0, 0, -1};
        for (const double bend : kFineBends)
            add_twists(u, bend, limb.arm ? kFineTwists : 3, limb.arm ? kFineTwists : 12);
        return;
    }
    for (int k = 0; k < kDirections; ++k) {
        const Vec3 u = direction(k);
        if (!reachable(limb, u)) continue;
        // A thigh rotates little about its axis, an upper arm much.
        for (const double bend : kBends)
            add_twists(u, bend, bend < kStraight || !limb.arm ? 1 : kTwists, kTwists);
    }
}

void LimbSearch::place_configurations(const BodyModel& model, const PosedBody& posed,
                                      const LimbSegments& limb) {
    const Rigid3& world_from_parent = posed.world_from_segment[kBodyParent[limb.upper]];
    placed_.clear();
    for (const Configuration& configuration : configurations_)
        append_capsules(model, world_from_parent, limb, {configuration.upper, configuration.lower, Mat3{}},
                        placed_);
}

// Lists the configurations, puts them at the joint and measures what lies outside. Returns the cost of the
// rays that none of them can be nearer to than the rest of the body is.
double LimbSearch::prepare(const BodyModel& model, const BodyPosture& posture,
                           std::span<const SilhouetteRays> views, const LimbSegments& limb,
                           LimbSearchScope scope, double robust_m) {
    list_configurations(posture, limb, scope);
    const PosedBody posed = model.forward(posture);
    place_configurations(model, posed, limb);
    measure_outside(views, placed_, placed_.size() / configurations_.size(), robust_m);
    return keep_reached(posed.joints_in_world[origin_joint(limb.upper)], robust_m);
}

// Incomplete, but at least `limit`, where it exceeds that.
double LimbSearch::cost_of(std::size_t n, double rest_cost, double robust_m, double limit) {
    const double known = rest_cost + outside_cost_[n];
    if (known >= limit) return known;
    const std::size_t count = placed_.size() / configurations_.size();
    return known +
           contour_cost(reached_, std::span(placed_).subspan(n * count, count), robust_m, limit - known);
}

BodyPosture LimbSearch::with(const Configuration& configuration, const LimbSegments& limb,
                             BodyPosture posture) {
    posture.parent_from_segment[limb.upper] = configuration.upper;
    posture.parent_from_segment[limb.lower] = configuration.lower;
    posture.parent_from_segment[limb.end] = Mat3{};
    return posture;
}

// The configuration of a limb with the lowest cost below `best`, which it updates. Most configurations leave
// the silhouettes, which is cheap to see: those that do least come first.
std::optional<BodyPosture> LimbSearch::cheapest(const BodyModel& model, const BodyPosture& posture,
                                                std::span<const SilhouetteRays> views, Limb which,
                                                LimbSearchScope scope, double robust_m, double& best) {
    const LimbSegments limb = segments_of(which);
    const double rest_cost = prepare(model, posture, views, limb, scope, robust_m);
    order_.resize(configurations_.size());
    std::iota(order_.begin(), order_.end(), 0);
    std::ranges::stable_sort(order_, {}, [&](int n) { return outside_cost_[n]; });
    const Configuration* found = nullptr;
    for (const int n : order_) {
        if (rest_cost + outside_cost_[n] >= best) break;
        const double there = cost_of(n, rest_cost, robust_m, best);
        if (there >= best) continue;
        best = there;
        found = &configurations_[n];
    }
    if (!found) return std::nullopt;
    return with(*found, limb, posture);
}

std::optional<BodyPosture> LimbSearch::improve(const BodyModel& model, const BodyPosture& posture,
                                               std::span<const SilhouetteRays> views, Limb which,
                                               LimbSearchScope scope, double robust_m) {
    double best = begin(model, posture, views, {&which, 1}, robust_m) - kRaysGained * robust_m * robust_m;
    return cheapest(model, posture, views, which, scope, robust_m, best);
}

std::vector<BodyPosture> LimbSearch::plausible(const BodyModel& model, const BodyPosture& posture,
                                               std::span<const SilhouetteRays> views, Limb which,
                                               double robust_m) {
    const LimbSegments limb = segments_of(which);
    const double limit =
        begin(model, posture, views, {&which, 1}, robust_m) + kPlausibleRays * robust_m * robust_m;
    const double rest_cost = prepare(model, posture, views, limb, LimbSearchScope::kWhole, robust_m);
    std::vector<std::pair<double, std::size_t>> found;
    for (std::size_t n = 0; n < configurations_.size(); ++n)
        if (const double there = cost_of(n, rest_cost, robust_m, limit); there < limit)
            found.emplace_back(there, n);
    std::ranges::sort(found);
    found.resize(std::min(found.size(), kMaxPlausible));
    std::vector<BodyPosture> postures;
    for (const auto& [cost, n] : found) postures.push_back(with(configurations_[n], limb, posture));
    return postures;
}

std::optional<BodyPosture> LimbSearch::improve_pair(const BodyModel& model, const BodyPosture& posture,
                                                    std::span<const SilhouetteRays> views, Limb first,
                                                    Limb second, double robust_m) {
    const Limb both[] = {first, second};
    const double now = begin(model, posture, views, both, robust_m);
    double best = kUnlimited;
    const auto one = cheapest(model, posture, views, first, LimbSearchScope::kWhole, robust_m, best);
    if (!one) return std::nullopt;
    std::vector<BodyCapsule> rest;
    split(model, *one, {&second, 1}, &rest);
    set_rest(rest);
    best = now + kPairSlack * robust_m * robust_m;
    return cheapest(model, *one, views, second, LimbSearchScope::kWhole, robust_m, best);
}

}  // namespace kinevox
